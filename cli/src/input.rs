//! Files that the user names.

use std::{
    cmp::Ordering,
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

use volery_api::worker::MODEL_FILES;
use volery_formats::{TelemetrySigmas, read_camera_json, read_positions_csv, read_telemetry_csv};
use volery_pipeline::{CameraSpec, ForeignModel, PipelineError, error::code, read_foreign_model};
use volery_scene::ImagePrior;

use crate::args::FlightArgs;

/// A photo by the name it goes by.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct PhotoFile {
    /// File name, or the path as given when two files share a name.
    pub(crate) name: String,
    /// Where.
    pub(crate) path: PathBuf,
}

/// Photos of folders (their own, not those of folders inside) and single photos, in the natural
/// order of their names.
pub(crate) fn photos(paths: &[PathBuf]) -> Result<Vec<PhotoFile>, PipelineError> {
    let mut found = Vec::new();
    for path in paths {
        if path.is_dir() {
            let entries = fs::read_dir(path).map_err(|e| PipelineError::io(path, &e))?;
            for entry in entries {
                let file = entry.map_err(|e| PipelineError::io(path, &e))?.path();
                if has_image_name(&file) && !file.is_dir() {
                    found.push(file);
                }
            }
        } else if path.exists() {
            found.push(path.clone());
        } else {
            return Err(PipelineError::plain(
                code::BAD_INPUT,
                format!("{} does not exist", path.display()),
            ));
        }
    }
    let mut files: Vec<PhotoFile> = found
        .into_iter()
        .map(|path| {
            let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
            PhotoFile { name, path }
        })
        .collect();
    files.sort_by(|a, b| natural_order(&a.name, &b.name).then_with(|| a.path.cmp(&b.path)));
    for i in 1..files.len() {
        if files[i].name == files[i - 1].name {
            files[i].name = files[i].path.to_string_lossy().into_owned();
        }
    }
    Ok(files)
}

fn has_image_name(path: &Path) -> bool {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    matches!(extension.as_deref(), Some("jpg" | "jpeg" | "png"))
}

/// Runs of digits compare as numbers: `2.jpg` before `10.jpg`.
fn natural_order(a: &str, b: &str) -> Ordering {
    let (mut a_rest, mut b_rest) = (a, b);
    loop {
        let (a_digits, a_next) = split_digits(a_rest);
        let (b_digits, b_next) = split_digits(b_rest);
        if !a_digits.is_empty() && !b_digits.is_empty() {
            let (x, y) = (a_digits.trim_start_matches('0'), b_digits.trim_start_matches('0'));
            let order = x.len().cmp(&y.len()).then_with(|| x.cmp(y));
            if order != Ordering::Equal {
                return order;
            }
            (a_rest, b_rest) = (a_next, b_next);
        } else {
            let (mut a_chars, mut b_chars) = (a_rest.chars(), b_rest.chars());
            match (a_chars.next(), b_chars.next()) {
                (None, None) => return a.cmp(b),
                (x, y) if x != y => return x.cmp(&y),
                _ => (a_rest, b_rest) = (a_chars.as_str(), b_chars.as_str()),
            }
        }
    }
}

fn split_digits(text: &str) -> (&str, &str) {
    let end = text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
    text.split_at(end)
}

/// A file's bytes.
pub(crate) fn read(path: &Path) -> Result<Vec<u8>, PipelineError> {
    fs::read(path)
        .map_err(|e| PipelineError::plain(code::BAD_INPUT, format!("{}: {e}", path.display())))
}

/// A calibration.
pub(crate) fn camera(path: &Path) -> Result<CameraSpec, PipelineError> {
    let camera = read_camera_json(&read(path)?).map_err(|e| unusable(path, &e))?;
    Ok((&camera).into())
}

/// Priors by image name.
pub(crate) fn telemetry(path: &Path) -> Result<BTreeMap<String, ImagePrior>, PipelineError> {
    let rows = read_telemetry_csv(&read(path)?, &TelemetrySigmas::default())
        .map_err(|e| unusable(path, &e))?;
    Ok(rows.into_iter().map(|row| (row.image, row.prior)).collect())
}

/// Priors by image name: telemetry, and positions, which win over those of the telemetry.
pub(crate) fn priors(flight: &FlightArgs) -> Result<BTreeMap<String, ImagePrior>, PipelineError> {
    let known = flight.telemetry.as_deref().map(telemetry).transpose()?;
    let mut priors = known.unwrap_or_default();
    if let Some(path) = &flight.positions {
        let positions = read_positions_csv(&read(path)?, flight.position_sigma)
            .map_err(|e| unusable(path, &e))?;
        for position in positions {
            priors.entry(position.image).or_default().position = Some(position.prior);
        }
    }
    Ok(priors)
}

/// The model of another program, a folder or a file, for photos of these names.
pub(crate) fn model(path: &Path, photos: BTreeSet<String>) -> Result<ForeignModel, PipelineError> {
    let files = model_files(path);
    let bytes = files.iter().map(|file| read(file)).collect::<Result<Vec<_>, _>>()?;
    let named: Vec<(String, &[u8])> = files
        .iter()
        .zip(&bytes)
        .map(|(file, bytes)| (file.display().to_string(), bytes.as_slice()))
        .collect();
    let model = read_foreign_model(&named, &photos)
        .map_err(|e| PipelineError { detail: format!("{}: {}", path.display(), e.detail), ..e })?;
    if model.images.is_empty() {
        let first = model.unknown.first().map_or("nothing", String::as_str);
        return Err(PipelineError::new(
            code::BAD_INPUT,
            format!(
                "{}: no image of the model is one of the photos; it names {first}",
                path.display()
            ),
            "give the photos that the model was made of, under the same names",
        ));
    }
    Ok(model)
}

/// The file itself, or those of a folder that hold poses.
fn model_files(path: &Path) -> Vec<PathBuf> {
    if !path.is_dir() {
        return vec![path.to_owned()];
    }
    let files = MODEL_FILES.iter().map(|name| path.join(name));
    files.filter(|file| file.is_file()).collect()
}

/// The file is there but makes no sense.
pub(crate) fn unusable(path: &Path, error: &impl std::fmt::Display) -> PipelineError {
    PipelineError::plain(code::BAD_INPUT, format!("{}: {error}", path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_are_numbers() {
        let mut names = ["a10.jpg", "a9.jpg", "a010.jpg", "b1.jpg", "a.jpg", "2.5.png", "2.jpg"];
        names.sort_by(|a, b| natural_order(a, b));
        assert_eq!(names, ["2.5.png", "2.jpg", "a.jpg", "a9.jpg", "a010.jpg", "a10.jpg", "b1.jpg"]);
    }
}
