//! Photos find their pose in a map of their room, and in no map of another (P60, P61).

use std::collections::BTreeMap;

use nalgebra::{Point3, Similarity3};
use rayon::prelude::*;
use volery_formats::{DecodeLimits, decode_image};
use volery_geometry::similarity_from_points;
use volery_localization::{LocalizationPrior, LocalizeOptions, PoseEstimate, Status};
use volery_pipeline::MapFolder;
use volery_tests::{SharedSet, evaluation::Poses};

use crate::{DESK, FOUNTAIN, MappedSet};

/// Folders of photos; those of the same room as a map are left out by their prefix.
const ALL_SETS: [&str; 9] = [
    "warehouse_render/scan",
    "warehouse_render/query",
    "warehouse_render/flight",
    "redkitchen",
    "redkitchen/query",
    "fr2_desk",
    "fr2_desk/query",
    "fountain_p11",
    "sceaux_castle",
];

/// The poses of the photos of `set` that the map answers with `ok`. A photo of a set without a
/// calibration is asked with the map's own camera, as a user would who mixed up two folders.
fn poses_in(map: &MapFolder, set: &SharedSet) -> BTreeMap<String, PoseEstimate> {
    let find = |name: &String| {
        let bytes = std::fs::read(set.images_dir.join(name)).unwrap();
        let gray = decode_image(&bytes, &DecodeLimits::default()).unwrap().gray;
        let own = set.camera.or_else(|| map.camera_for(gray.width(), gray.height()))?;
        let (answer, _) =
            map.localize(&gray, &own, &LocalizationPrior::default(), &LocalizeOptions::default());
        match answer.status {
            Status::Ok(pose) => Some((name.clone(), pose)),
            _ => None,
        }
    };
    set.images.par_iter().filter_map(find).collect()
}

/// A confident wrong pose moves a real drone: no photo of another room is given one. Every
/// `step`-th photo is asked.
fn assert_no_strangers(map: &MapFolder, room: &str, step: usize) {
    for name in ALL_SETS.iter().filter(|name| !name.starts_with(room)) {
        let Some(mut set) = SharedSet::open(name) else { continue };
        if let (None, Some((parent, _))) = (set.camera, name.split_once('/')) {
            set.camera = SharedSet::open(parent).and_then(|parent| parent.camera);
        }
        set.images = set.images.into_iter().step_by(step).collect();
        let found = poses_in(map, &set);
        println!("{room} asked by {} photos of {name}: {} ok", set.images.len(), found.len());
        assert!(found.is_empty(), "{name} in {room}: {:?}", found.keys());
    }
}

#[test]
fn warehouse_queries_find_their_pose() {
    let Some(MappedSet { set, map, poses, .. }) = MappedSet::new("warehouse_render/scan") else {
        return;
    };
    let Some(queries) = SharedSet::open("warehouse_render/query") else { return };
    assert!(poses.len() >= 108, "{} of 110 photos placed", poses.len());
    let truth_from_map = truth_from_map(&poses, &set.truth);
    let kinds = kinds(&queries);
    let found = poses_in(&map, &queries);

    let mut errors_m = Vec::new();
    let mut num_right: BTreeMap<&str, usize> = BTreeMap::new();
    for (name, pose) in &found {
        let truth = &queries.truth[name];
        let center = truth_from_map * Point3::from(pose.map_from_camera.translation.vector);
        let rotation = truth_from_map.isometry.rotation * pose.map_from_camera.rotation;
        let error_m = (center.coords - truth.translation.vector).norm();
        let error_deg = rotation.angle_to(&truth.rotation).to_degrees();
        println!("{name} {}: {:.1} mm, {error_deg:.3} deg", kinds[name], 1e3 * error_m);
        assert!(error_m <= 0.1 && error_deg <= 2.0, "{name} is confidently wrong");
        *num_right.entry(&kinds[name]).or_default() += 1;
        errors_m.push(error_m);
    }
    let right = |kind: &str| num_right.get(kind).copied().unwrap_or(0);
    assert_eq!(right("near"), 14);
    assert!(right("away") >= 14, "away: {} of 16", right("away"));
    assert!(right("wall") >= 6, "wall: {} of 8", right("wall"));
    assert_eq!(right("unseen"), 0, "what the scan never saw cannot be placed");
    errors_m.sort_by(f64::total_cmp);
    assert!(errors_m[errors_m.len() / 2] <= 0.01, "median {}", errors_m[errors_m.len() / 2]);
    assert_no_strangers(&map, "warehouse_render", step());
    assert_flight_is_followed(&map, &truth_from_map);
}

/// Small frames of a flight, some of them dark or blurred by motion: nearly all are found, none is
/// wrong.
fn assert_flight_is_followed(map: &MapFolder, truth_from_map: &Similarity3<f64>) {
    let Some(mut flight) = SharedSet::open("warehouse_render/flight") else { return };
    flight.images = flight.images.into_iter().step_by(step()).collect();
    let found = poses_in(map, &flight);
    let mut errors_m = Vec::new();
    for (name, pose) in &found {
        let center = truth_from_map * Point3::from(pose.map_from_camera.translation.vector);
        let error_m = (center.coords - flight.truth[name].translation.vector).norm();
        assert!(error_m <= 0.15, "{name} is confidently wrong by {error_m} m");
        errors_m.push(error_m);
    }
    errors_m.sort_by(f64::total_cmp);
    let median_m = errors_m[errors_m.len() / 2];
    println!("flight: {} of {}, median {median_m:.4} m", found.len(), flight.images.len());
    assert!(found.len() * 10 >= flight.images.len() * 9, "{} found", found.len());
    assert!(median_m <= 0.02, "median {median_m} m");
}

/// Every photo with `VOLERY_LONG=1`, else every sixth.
fn step() -> usize {
    if is_long() { 1 } else { 6 }
}

fn is_long() -> bool {
    std::env::var_os("VOLERY_LONG").is_some()
}

#[test]
fn strangers_find_no_pose_in_any_room() {
    let others: &[&str] = if is_long() { &["sceaux_castle", "redkitchen"] } else { &[] };
    let others: Vec<MappedSet> = others.iter().copied().filter_map(MappedSet::new).collect();
    for room in DESK.iter().chain(FOUNTAIN.iter()).chain(&others) {
        assert_no_strangers(&room.map, &room.set.name, step());
    }
}

fn truth_from_map(poses: &Poses, truth: &Poses) -> Similarity3<f64> {
    let center = |poses: &Poses, name: &String| Point3::from(poses[name].translation.vector);
    let in_map: Vec<_> = poses.keys().map(|name| center(poses, name)).collect();
    let in_truth: Vec<_> = poses.keys().map(|name| center(truth, name)).collect();
    similarity_from_points(&in_map, &in_truth).unwrap()
}

/// `near`, `away`, `wall` or `unseen` per photo.
fn kinds(queries: &SharedSet) -> BTreeMap<String, String> {
    let table = std::fs::read_to_string(queries.dir.join("frames.csv")).unwrap();
    let mut lines = table.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = header.iter().position(|name| *name == "kind").unwrap();
    lines
        .map(|line| line.split(',').collect::<Vec<_>>())
        .map(|row| (row[0].to_owned(), row[column].to_owned()))
        .collect()
}
