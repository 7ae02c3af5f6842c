//! The pipeline over a few rendered photos: interrupted anywhere it goes on and ends the same.

mod support;

use std::{fs, path::Path};

use support::{Folder, Scan, StopIn};
use volery_geometry::{Isometry3, Point3, Vector3, similarity_from_points};
use volery_pipeline::{ImageInput, JobSpec, MapFolder, map_folder::read_map, reconstruct};
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

/// Largest distance of a camera from where it was, after a similarity fit.
fn worst_error(folder: &Path, poses: &[Isometry3<f64>]) -> f64 {
    let (_, map) = read_map(folder).unwrap();
    let found: Vec<Point3<f64>> = map.model.images.values().map(|image| image.center()).collect();
    let truth: Vec<Point3<f64>> =
        poses.iter().map(|pose| pose.inverse().translation.vector.into()).collect();
    let truth_from_map = similarity_from_points(&found, &truth).unwrap();
    let errors =
        found.iter().zip(&truth).map(|(found, truth)| (truth_from_map * found - truth).norm());
    errors.fold(0.0, f64::max)
}

/// Photos of two halls: the larger part is the map, the other one a map folder inside it.
#[test]
fn a_part_that_nothing_ties_to_the_map_is_kept_as_a_zone() {
    let folder = Folder::new("zones");
    let scan = Scan::new(&folder.0, NUM_PHOTOS);
    let away = folder.0.join("away");
    fs::create_dir(&away).unwrap();
    let other = Scan::of_hall(Vector3::new(10.0, 5.6, 4.2), 77, &away, NUM_PHOTOS - 2);
    let mut both = scan.spec.clone();
    let renamed = other
        .spec
        .images
        .iter()
        .map(|image| ImageInput { name: format!("away {}", image.name), ..image.clone() });
    both.images.extend(renamed);
    let out = folder.0.join("out");
    let summary = reconstruct(&both, &folder.0.join("work"), &out, &NoProgress).unwrap();
    assert_eq!((summary.num_registered, summary.num_zones), (NUM_PHOTOS, 1));
    let reasons = summary.images[NUM_PHOTOS..].iter().map(|image| image.reason.map(|r| r.code()));
    assert!(reasons.eq((2..NUM_PHOTOS).map(|_| Some("other_zone"))));
    assert!(worst_error(&out, &scan.poses) < 0.02);

    let zone = out.join("zones/1");
    assert!(worst_error(&zone, &other.poses) < 0.02);
    let map = MapFolder::open(&zone).unwrap();
    assert_eq!(map.info().quality.reasons[0].code, "zone");

    // The next map of this folder has none.
    reconstruct(&scan.spec, &folder.0.join("work"), &out, &NoProgress).unwrap();
    assert!(!zone.exists());
}
