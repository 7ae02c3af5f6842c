//! Poses and cameras that another program found.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Isometry3;
use volery_formats::{ColmapFiles, read_colmap_poses, read_transforms_json};
use volery_scene::SparseModel;

use crate::{
    error::{PipelineError, code},
    spec::CameraSpec,
};

/// What a model of another program says of photos.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ForeignModel {
    /// `cam_from_world` and intrinsics, by the name of the photo.
    pub images: BTreeMap<String, (Isometry3<f64>, CameraSpec)>,
    /// Names in the model that are no photo's.
    pub unknown: Vec<String>,
}

/// Reads a model for the photos of these names: COLMAP's `cameras` and `images`, both `.txt` or both
/// `.bin`, or a `transforms.json`, told by the names of the files; folders before the names and other
/// files do not matter.
///
/// A photo is an image of the model if their names are equal, or are without folders, or without
/// folders and extensions, and no two of either side are.
///
/// # Errors
///
/// [`code::BAD_MODEL`] for files that make no sense or are missing.
pub fn read_foreign_model(
    files: &[(String, &[u8])],
    photos: &BTreeSet<String>,
) -> Result<ForeignModel, PipelineError> {
    let bad = |detail: String| PipelineError::plain(code::BAD_MODEL, detail);
    let mut seen = BTreeSet::new();
    if let Some((name, _)) = files.iter().find(|(name, _)| !seen.insert(base_name(name))) {
        return Err(bad(format!("{} is there twice: give one model", base_name(name))));
    }
    let file = |wanted: &str| {
        files.iter().find(|(name, _)| base_name(name) == wanted).map(|(_, bytes)| *bytes)
    };
    let colmap = |extension: &str| {
        let cameras = file(&format!("cameras.{extension}"))?.to_vec();
        let images = file(&format!("images.{extension}"))?.to_vec();
        Some(ColmapFiles { cameras, images, points: Vec::new() })
    };
    let model = if let Some(files) = colmap("bin") {
        read_colmap_poses(&files, true).map_err(|e| bad(e.to_string()))?
    } else if let Some(files) = colmap("txt") {
        read_colmap_poses(&files, false).map_err(|e| bad(e.to_string()))?
    } else if let Some(text) = file("transforms.json") {
        let text = std::str::from_utf8(text).map_err(|e| bad(format!("transforms.json: {e}")))?;
        read_transforms_json(text).map_err(|e| bad(e.to_string()))?
    } else {
        return Err(PipelineError::new(
            code::BAD_MODEL,
            "there is no model",
            "give COLMAP's cameras and images, .txt or .bin, or a transforms.json",
        ));
    };
    Ok(assign(&model, photos))
}

fn assign(model: &SparseModel, photos: &BTreeSet<String>) -> ForeignModel {
    let mut assigned = ForeignModel::default();
    let names: BTreeSet<&str> = model.images.values().map(|image| image.name.as_str()).collect();
    let levels: [fn(&str) -> &str; 3] = [|name| name, base_name, stem];
    let lookups = levels.map(|key| (key, unique(photos.iter().map(String::as_str), key)));
    let sound = levels.map(|key| unique(names.iter().copied(), key));
    for image in model.images.values() {
        let name = image.name.as_str();
        let photo = lookups.iter().zip(&sound).find_map(|((key, photos), names)| {
            names.get(key(name)).and_then(|_| photos.get(key(name)).copied())
        });
        match (photo, model.cameras.get(&image.camera)) {
            (Some(photo), Some(camera)) => {
                let of = (image.cam_from_world, CameraSpec::from(camera));
                assigned.images.insert(photo.to_owned(), of);
            }
            _ => assigned.unknown.push(name.to_owned()),
        }
    }
    assigned
}

/// Names by their keys, without those of which two have the same.
fn unique<'a>(
    names: impl Iterator<Item = &'a str>,
    key: fn(&str) -> &str,
) -> BTreeMap<&'a str, &'a str> {
    let mut by_key: BTreeMap<&str, Option<&str>> = BTreeMap::new();
    for name in names {
        by_key.entry(key(name)).and_modify(|known| *known = None).or_insert(Some(name));
    }
    by_key.into_iter().filter_map(|(key, name)| Some((key, name?))).collect()
}

fn base_name(name: &str) -> &str {
    name.rsplit(['/', '\\']).next().unwrap_or(name)
}

fn stem(name: &str) -> &str {
    let base = base_name(name);
    base.rsplit_once('.').map_or(base, |(stem, _)| stem)
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMERAS: &[u8] = b"1 PINHOLE 640 480 500 500 320 240\n";

    fn read(images: &str, photos: &[&str]) -> ForeignModel {
        let files = [
            ("sparse/0/cameras.txt".to_owned(), CAMERAS),
            ("images.txt".to_owned(), images.as_bytes()),
        ];
        let photos = photos.iter().map(|&photo| photo.to_owned()).collect();
        read_foreign_model(&files, &photos).unwrap()
    }

    fn named(names: &[&str]) -> String {
        let lines = names.iter().enumerate();
        lines.map(|(i, name)| format!("{} 1 0 0 0 0 0 0 1 {name}\n\n", i + 1)).collect()
    }

    #[test]
    fn photos_are_found_without_folders_and_extensions() {
        let model =
            read(&named(&["in/a.png", "b.jpg", "c.png", "z.jpg"]), &["a.png", "b.jpg", "c.jpg"]);
        let found: Vec<&str> = model.images.keys().map(String::as_str).collect();
        assert_eq!(found, ["a.png", "b.jpg", "c.jpg"]);
        assert_eq!(model.unknown, ["z.jpg"]);
    }

    #[test]
    fn what_could_be_two_photos_is_none() {
        let model =
            read(&named(&["a.png", "left/b.jpg", "right/b.jpg"]), &["a.jpg", "a.jpeg", "b.jpg"]);
        assert!(model.images.is_empty(), "{:?}", model.images);
        assert_eq!(model.unknown, ["a.png", "left/b.jpg", "right/b.jpg"]);
    }

    #[test]
    fn files_that_make_no_sense_are_named() {
        let images = named(&["a.jpg"]);
        let refused =
            |files: &[(String, &[u8])]| read_foreign_model(files, &BTreeSet::new()).unwrap_err();
        let images = ("images.txt".to_owned(), images.as_bytes());
        assert_eq!(refused(std::slice::from_ref(&images)).code, code::BAD_MODEL);
        let error = refused(&[("cameras.txt".to_owned(), b"1 PINHOLE 640".as_slice()), images]);
        assert!(error.detail.contains("Cameras file, line or record 1"), "{}", error.detail);
    }
}
