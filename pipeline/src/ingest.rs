//! First stage: files to photos with features.

use std::{
    collections::BTreeMap,
    fs,
    sync::atomic::{AtomicUsize, Ordering},
};

use rayon::prelude::*;
use volery_scene::{Progress, Stage};

use crate::{
    cache::{Cache, Key},
    error::{PipelineError, code},
    options::StageOptions,
    photo::Photo,
    spec::{ImageInput, JobSpec},
};

/// A photo that takes part in the mapping.
pub(crate) struct Usable {
    /// Index into [`JobSpec::images`].
    pub(crate) input: usize,
    /// Key of its features.
    pub(crate) key: Key,
    /// Its features.
    pub(crate) photo: Photo,
}

/// What became of an input that does not take part.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Fate {
    /// Takes part, as the usable photo of this index.
    Usable(usize),
    /// Has the same bytes as this input.
    DuplicateOf(usize),
    /// Could not be read: stable code and detail.
    Unreadable(&'static str, String),
}

/// All inputs after the first stage.
pub(crate) struct Ingested {
    /// Photos that take part, in the order given.
    pub(crate) usable: Vec<Usable>,
    /// One per input.
    pub(crate) fates: Vec<Fate>,
    /// Hash of every file; `None` if there is none.
    pub(crate) hashes: Vec<Option<blake3::Hash>>,
    /// How many came from the cache.
    pub(crate) num_cached: usize,
}

/// Reads every file once for its hash, drops repeated ones, and takes the features of the rest.
/// At any time at most one photo per thread is in memory as pixels.
pub(crate) fn ingest(
    spec: &JobSpec,
    options: &StageOptions,
    cache: &Cache,
    progress: &dyn Progress,
) -> Result<Ingested, PipelineError> {
    check_names(&spec.images)?;
    let total = spec.images.len();
    progress.report(Stage::Features, 0, total);
    let hashes: Vec<_> = spec
        .images
        .par_iter()
        .map(|image| {
            progress.check()?;
            Ok(fs::read(&image.path).map(|bytes| blake3::hash(&bytes)).map_err(|e| e.to_string()))
        })
        .collect::<Result<Vec<Result<blake3::Hash, String>>, PipelineError>>()?;

    let mut first_of: BTreeMap<[u8; 32], usize> = BTreeMap::new();
    let repeats: Vec<Option<usize>> = hashes
        .iter()
        .enumerate()
        .map(|(i, hash)| {
            let first = *first_of.entry(*hash.as_ref().ok()?.as_bytes()).or_insert(i);
            (first != i).then_some(first)
        })
        .collect();

    let (done, num_cached) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let outcomes: Vec<Result<(Key, Photo), Fate>> = (0..total)
        .into_par_iter()
        .map(|i| {
            progress.check()?;
            let outcome = match (&hashes[i], repeats[i]) {
                (Err(detail), _) => Err(Fate::Unreadable("unreadable", detail.clone())),
                (_, Some(first)) => Err(Fate::DuplicateOf(first)),
                (Ok(hash), None) => photo(&spec.images[i], hash, options, cache, &num_cached)?,
            };
            progress.report(Stage::Features, done.fetch_add(1, Ordering::Relaxed) + 1, total);
            Ok(outcome)
        })
        .collect::<Result<_, PipelineError>>()?;

    let mut usable = Vec::new();
    let fates = outcomes
        .into_iter()
        .enumerate()
        .map(|(input, outcome)| match outcome {
            Ok((key, photo)) => {
                usable.push(Usable { input, key, photo });
                Fate::Usable(usable.len() - 1)
            }
            Err(fate) => fate,
        })
        .collect();
    let hashes = hashes.into_iter().map(Result::ok).collect();
    Ok(Ingested { usable, fates, hashes, num_cached: num_cached.into_inner() })
}

fn photo(
    image: &ImageInput,
    hash: &blake3::Hash,
    options: &StageOptions,
    cache: &Cache,
    num_cached: &AtomicUsize,
) -> Result<Result<(Key, Photo), Fate>, PipelineError> {
    let key = Photo::key(hash, options);
    if let Some(photo) = cache.get(&key).and_then(|bytes| Photo::from_cache(&bytes)) {
        num_cached.fetch_add(1, Ordering::Relaxed);
        return Ok(Ok((key, photo)));
    }
    let bytes = fs::read(&image.path).map_err(|e| PipelineError::io(&image.path, &e))?;
    match Photo::from_bytes(&bytes, options) {
        Ok(photo) => {
            let content = photo
                .to_bytes()
                .map_err(|e| PipelineError::plain(code::IO, format!("{}: {e}", image.name)))?;
            cache.put(&key, &content)?;
            Ok(Ok((key, photo)))
        }
        Err(error) => Ok(Err(Fate::Unreadable(error.code(), error.to_string()))),
    }
}

/// Names end up in files whose fields are separated by commas and blanks.
fn check_names(images: &[ImageInput]) -> Result<(), PipelineError> {
    let mut seen = std::collections::BTreeSet::new();
    for ImageInput { name, .. } in images {
        if name.is_empty() || name.chars().any(|c| c.is_control() || c == ',' || c == '"') {
            return Err(PipelineError::new(
                code::BAD_INPUT,
                format!("image name {name:?} is empty or has a comma, quote or control character"),
                "rename the file",
            ));
        }
        if !seen.insert(name) {
            return Err(PipelineError::new(
                code::BAD_INPUT,
                format!("two images are named {name:?}"),
                "give every image a name of its own",
            ));
        }
    }
    Ok(())
}
