use nalgebra::Vector3;
use volery_geometry::Rng;
use volery_scene::{OrientedPoint, PointCloud};
use volery_synthetic::{Room, ScanOptions, Zone as Scan};

use super::*;
use crate::FreeDirection;
use crate::test_zones::{CELL, moved, off, random_frame, whole, zone};

fn find(source: &Scan, target: &Scan) -> Result<Registration, RegistrationError> {
    register_anywhere(&zone(source), &zone(target), &NearbyOptions::default())
}

/// P53 from bad starts: halves of a room that share a third, in frames of their own.
#[test]
fn parts_of_a_room_are_joined_wherever_they_start() {
    for seed in 0..3 {
        let room = Room::random(Vector3::new(10.0, 7.0, 3.0), 4.0, seed);
        let scans = room.zones([2, 1], 0.33, &ScanOptions::default(), seed);
        let mut rng = Rng::new(seed);
        let frames = [random_frame(&mut rng), random_frame(&mut rng)];
        let [a, b] = [0, 1].map(|k| moved(&scans[k], &frames[k]));
        let found = find(&a, &b).unwrap();
        let truth = frames[1] * frames[0].inverse();
        let middle = zone(&a).surfels().center();
        let (shift, turn) = off(&found.target_from_source, &truth, &middle);
        assert!(shift < 0.005 && turn < 0.1_f64.to_radians(), "{seed}: {shift} m, {turn}");
        assert!(found.overlap.fraction > 0.2 && found.overlap.contradiction < 0.02);
        // What it says of itself is about true: six degrees of freedom, 99.99 % below 28.
        let error = crate::join::tests::twist_between(&found, &truth);
        let information = found.constraint.information;
        assert!(error.dot(&(information * error)) < 28.0);
    }
}

/// 200 pairs of different rooms, half of them with walls of the same size, are never merged; in
/// the short form 8.
#[test]
fn rooms_that_do_not_overlap_are_never_merged() {
    let num_trials = if std::env::var_os("VOLERY_LONG").is_some() { 200 } else { 8 };
    let mut refusals = std::collections::BTreeMap::new();
    for trial in 0..num_trials {
        let mut rng = Rng::fork(7, trial);
        let mut size =
            || Vector3::new(rng.range(5.0, 10.0), rng.range(4.0, 8.0), rng.range(2.5, 3.5));
        let first = size();
        let second = if trial % 2 == 0 { first } else { size() };
        let scan = |size, seed| {
            let room = Room::random(size, rng.clone().range(2.5, 8.0), seed);
            let scan = whole(&room, 20_000, seed);
            moved(&scan, &random_frame(&mut Rng::new(seed)))
        };
        let found = find(&scan(first, 1000 + trial), &scan(second, 5000 + trial));
        let refusal = found.expect_err(&format!("trial {trial} merged two rooms"));
        *refusals.entry(refusal.code()).or_insert(0) += 1;
    }
    assert!(refusals.keys().all(|code| ["no_overlap", "ambiguous"].contains(code)), "{refusals:?}");
}

/// Surfaces that slide on themselves.
fn surface(mut point: impl FnMut(&mut Rng) -> (Point3<f64>, Vector3<f64>)) -> Scan {
    let mut rng = Rng::new(3);
    let points = (0..30_000).map(|_| {
        let (p, n) = point(&mut rng);
        OrientedPoint {
            position: (p + rng.normal3() * 0.004).cast(),
            normal: (n + rng.normal3() * 0.05).normalize().cast(),
            color: [0; 3],
            confidence: 255,
            inferred: false,
        }
    });
    Scan {
        cloud: PointCloud { points: points.collect() },
        viewpoints: vec![Point3::new(1.0, 1.0, 1.2)],
    }
}

#[test]
fn a_bare_plane_is_refused_with_its_free_directions() {
    let plane =
        surface(|rng| (Point3::new(rng.range(-3.0, 3.0), rng.range(-3.0, 3.0), 0.0), Vector3::z()));
    let Err(RegistrationError::Underconstrained { directions }) = find(&plane, &plane) else {
        panic!("a plane was placed");
    };
    let turns = directions.iter().filter(|d| matches!(d, FreeDirection::Turn(v) if v.z > 0.99));
    assert_eq!((directions.len(), turns.count()), (3, 1), "{directions:?}");
}

#[test]
fn a_bare_corridor_is_refused_also_from_a_good_start() {
    let corridor = surface(|rng| {
        let x = rng.range(-5.0, 5.0);
        match rng.index(3) {
            0 => (Point3::new(x, rng.range(0.0, 2.0), 0.0), Vector3::z()),
            1 => (Point3::new(x, 0.0, rng.range(0.0, 2.5)), Vector3::y()),
            _ => (Point3::new(x, 2.0, rng.range(0.0, 2.5)), -Vector3::y()),
        }
    });
    let zone = zone(&corridor);
    let start = Similarity3::identity();
    let options = NearbyOptions::default();
    for result in
        [register_anywhere(&zone, &zone, &options), register_from(&zone, &zone, &start, &options)]
    {
        let Err(RegistrationError::Underconstrained { directions }) = result else {
            panic!("a corridor was placed");
        };
        let [FreeDirection::Slide(along)] = directions[..] else { panic!("{directions:?}") };
        assert!(along.x > 0.99, "{along}");
    }
}

/// An empty room looks the same when turned by half.
#[test]
fn an_empty_room_is_ambiguous() {
    let room = Room { size: Vector3::new(6.0, 4.5, 2.6), furniture: Vec::new() };
    let found = find(&whole(&room, 20_000, 1), &whole(&room, 20_000, 2));
    let Err(error @ RegistrationError::Ambiguous { .. }) = found else {
        panic!("{found:?}");
    };
    assert_eq!(error.code(), "ambiguous");
}

#[test]
fn the_answer_does_not_depend_on_threads() {
    let room = Room::random(Vector3::new(7.0, 6.0, 3.0), 4.0, 5);
    let [a, b] = [1, 2].map(|seed| whole(&room, 15_000, seed));
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| find(&a, &b).unwrap())
    };
    assert_eq!(with(1), with(3));
}

#[test]
fn bad_input_is_named() {
    let room = Room::random(Vector3::new(6.0, 5.0, 3.0), 4.0, 5);
    let mut scan = whole(&room, 5000, 1);
    scan.viewpoints[1].x = f64::NAN;
    let error = Zone::new(&scan.cloud, &scan.viewpoints, CELL).unwrap_err();
    assert_eq!(error, RegistrationError::NotFinite { index: 1 });
    assert_eq!(error.code(), "invalid");
    assert_eq!(Zone::new(&PointCloud::default(), &[], CELL).unwrap_err().code(), "too_few_points");
}
