//! The pipeline over a few rendered photos: interrupted anywhere it goes on and ends the same.

mod support;

use std::{fs, path::Path};

use support::{Folder, Scan, StopIn};
use volery_pipeline::{ImageInput, JobSpec, MapFolder, reconstruct};
use volery_scene::{NoProgress, Stage};

const NUM_PHOTOS: usize = 10;

fn photos(folder: &Path) -> JobSpec {
    Scan::new(folder, NUM_PHOTOS).spec
}

fn map_files(folder: &Path) -> Vec<(String, Vec<u8>)> {
    ["poses.csv", "colmap/images.txt", "colmap/points3D.txt", "map.json", "localization.bin"]
        .into_iter()
        .map(|name| (name.to_owned(), fs::read(folder.join(name)).unwrap()))
        .collect()
}

/// Cancelled in every stage, one after the other in one work folder, the run ends with the bytes
/// of an undisturbed one, and finished units are not done again.
#[test]
fn a_run_cancelled_in_every_stage_ends_with_the_same_bytes() {
    let folder = Folder::new("cancel");
    let spec = photos(&folder.0);
    let (calm, rough) = (folder.0.join("calm"), folder.0.join("rough"));
    let summary = reconstruct(&spec, &folder.0.join("work-calm"), &calm, &NoProgress).unwrap();
    assert_eq!(summary.num_registered, NUM_PHOTOS, "{:?}", summary.quality);

    let work = folder.0.join("work-rough");
    for stage in [Stage::Features, Stage::Matching, Stage::Mapping, Stage::Export] {
        let progress = StopIn::new(stage);
        let error = reconstruct(&spec, &work, &rough, &progress).unwrap_err();
        assert!(error.is_cancelled(), "{stage:?}: {error}");
        assert!(!rough.join("map.json").exists(), "{stage:?}: no half map");
    }
    let summary = reconstruct(&spec, &work, &rough, &NoProgress).unwrap();
    for stage in &summary.stages {
        if ["features", "matching", "mapping"].contains(&stage.name.as_str()) {
            assert_eq!(stage.cached, stage.units, "{} was done already", stage.name);
        }
    }
    assert!(map_files(&calm) == map_files(&rough));
    assert!(MapFolder::open(&rough).is_ok());
}

/// A photo that comes twice is computed once and gets its pose; a file that is no photo is named
/// in the report and harms nobody.
#[test]
fn repeated_and_unreadable_photos_do_not_disturb_the_map() {
    let folder = Folder::new("repeat");
    let mut spec = photos(&folder.0);
    let copy = folder.0.join("copy.png");
    fs::copy(&spec.images[3].path, &copy).unwrap();
    let text = folder.0.join("text.jpg");
    fs::write(&text, "no photo").unwrap();
    spec.images.push(ImageInput::new("copy.png", copy));
    spec.images.push(ImageInput::new("text.jpg", text));
    let out = folder.0.join("out");
    let summary = reconstruct(&spec, &folder.0.join("work"), &out, &NoProgress).unwrap();
    assert_eq!(summary.num_registered, NUM_PHOTOS + 1);
    let report = |name: &str| summary.images.iter().find(|image| image.name == name).unwrap();
    assert_eq!(report("copy.png").duplicate_of.as_deref(), Some("3.png"));
    assert!(report("text.jpg").detail.as_deref().unwrap().contains("not_an_image"));
    let codes: Vec<&str> = summary.warnings.iter().map(|w| w.code.as_str()).collect();
    assert!(codes.contains(&"duplicate_images") && codes.contains(&"undecodable_images"));
    let poses = fs::read_to_string(out.join("poses.csv")).unwrap();
    let pose_of = |name: &str| {
        let line = poses.lines().find(|line| line.starts_with(name)).unwrap();
        line.split_once(',').unwrap().1.to_owned()
    };
    assert_eq!(pose_of("copy.png"), pose_of("3.png"));
}
