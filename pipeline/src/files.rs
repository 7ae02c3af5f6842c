//! The photos of a map, read when they are needed.

use std::{
    collections::BTreeMap,
    path::{Path, PathBuf},
};

use rayon::prelude::*;
use volery_formats::{DecodeLimits, decode_image};
use volery_scene::{ImageId, Photo, Photos, SparseModel};

use crate::{ingest::Ingested, map_folder::MapInput, spec::JobSpec};

/// A photo on disk.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct PhotoFile {
    pub(crate) path: PathBuf,
    /// Of its bytes.
    pub(crate) hash: blake3::Hash,
}

/// Files of the images of a model.
pub(crate) struct Files(BTreeMap<ImageId, PhotoFile>);

impl Files {
    /// Of a model made from the photos of a job, whose images are numbered as those.
    pub(crate) fn of_job(spec: &JobSpec, ingested: &Ingested) -> Self {
        let usable = (0..).map(ImageId).zip(&ingested.usable);
        let file = |(id, usable): (ImageId, &crate::ingest::Usable)| {
            let path = spec.images[usable.input].path.clone();
            Some((id, PhotoFile { path, hash: ingested.hashes[usable.input]? }))
        };
        Self(usable.filter_map(file).collect())
    }

    /// Of a model whose images are known by the names of its inputs, among files of any name.
    pub(crate) fn of_inputs(
        model: &SparseModel,
        inputs: &[MapInput],
        candidates: &[PathBuf],
    ) -> Self {
        let by_hash: BTreeMap<String, (blake3::Hash, &PathBuf)> = candidates
            .par_iter()
            .filter_map(|path| Some((hash_of(path)?, path)))
            .map(|(hash, path)| (hash.to_hex().to_string(), (hash, path)))
            .collect();
        let of_name: BTreeMap<&str, &str> =
            inputs.iter().map(|input| (input.name.as_str(), input.blake3.as_str())).collect();
        let files = model.images.iter().filter_map(|(id, image)| {
            let (hash, path) = by_hash.get(*of_name.get(image.name.as_str())?)?;
            Some((*id, PhotoFile { path: (*path).clone(), hash: *hash }))
        });
        Self(files.collect())
    }

    /// Of an image, if it is there.
    pub(crate) fn get(&self, image: ImageId) -> Option<&PhotoFile> {
        self.0.get(&image)
    }
}

fn hash_of(path: &Path) -> Option<blake3::Hash> {
    std::fs::read(path).ok().map(|bytes| blake3::hash(&bytes))
}

impl Photos for Files {
    fn photo(&self, image: ImageId) -> Option<Photo> {
        let bytes = std::fs::read(&self.get(image)?.path).ok()?;
        let decoded = decode_image(&bytes, &DecodeLimits::default()).ok()?;
        let rgb = decoded.color.as_ref().map(|color| color.to_rgb());
        let colors = rgb.map(|rgb| rgb.as_chunks::<3>().0.to_vec());
        Some(Photo { gray: decoded.gray, colors })
    }
}
