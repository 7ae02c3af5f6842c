use nalgebra::Vector3;
use volery_geometry::Rng;
use volery_scene::{Cancelled, NoProgress};
use volery_synthetic::{Room, ScanOptions};

use super::*;
use crate::constraint::{Twist, twist};
use crate::test_zones::{moved, off, random_frame, whole, zone};

/// The error of a registration about its center.
pub(crate) fn twist_between(found: &Registration, truth: &Similarity3<f64>) -> Twist {
    let error = found.target_from_source * truth.inverse();
    let center = found.constraint.center;
    twist(&error.isometry.rotation.scaled_axis(), &(error * center - center), 0.0)
}

/// Zones of a hall, each in a frame of its own, and those frames.
fn hall(grid: [usize; 2], size: [f64; 2], seed: u64) -> (Vec<Zone>, Vec<Similarity3<f64>>) {
    let room = Room::random(Vector3::new(size[0], size[1], 4.0), 4.0, seed);
    let options = ScanOptions { num_points: 60_000, ..Default::default() };
    let mut rng = Rng::fork(seed, 1);
    room.zones(grid, 0.3, &options, seed)
        .iter()
        .map(|scan| {
            let frame = random_frame(&mut rng);
            (zone(&moved(scan, &frame)), frame)
        })
        .unzip()
}

/// P52: zones of a hall that overlap by 30 %, each in a frame of its own, end in one frame within
/// 5 mm and 0.05 degrees. Twelve in the long form, four in the short one.
#[test]
fn zones_from_random_starts_end_in_one_frame() {
    let is_long = std::env::var_os("VOLERY_LONG").is_some();
    let seeds = if is_long { 0..3 } else { 0..1 };
    for seed in seeds {
        let (grid, size) = if is_long { ([4, 3], [24.0, 16.0]) } else { ([2, 2], [12.5, 11.0]) };
        let (zones, frames) = hall(grid, size, seed);
        let joined = join_zones(&zones, &[], &NearbyOptions::default(), &NoProgress).unwrap();
        for (i, placement) in joined.placements.iter().enumerate() {
            assert_eq!(placement.reference, 0, "zone {i} was left out");
            let truth = frames[0] * frames[i].inverse();
            let middle = zones[i].surfels().center();
            let (shift, turn) = off(&placement.frame_from_zone, &truth, &middle);
            assert!(shift < 0.005 && turn.to_degrees() < 0.05, "zone {i}: {shift} m, {turn}");
        }
        let used = joined.pairs.iter().filter(|pair| pair.is_used).count();
        assert!(used >= zones.len(), "{used} links close no loop");
    }
}

/// Two rooms of two zones each stay two frames.
#[test]
fn zones_of_two_rooms_stay_apart() {
    let (mut zones, _) = hall([2, 1], [10.0, 6.0], 1);
    zones.extend(hall([2, 1], [10.0, 6.0], 2).0);
    let joined = join_zones(&zones, &[], &NearbyOptions::default(), &NoProgress).unwrap();
    let references: Vec<usize> = joined.placements.iter().map(|p| p.reference).collect();
    assert_eq!(references, [0, 0, 2, 2]);
    assert_eq!(joined.placements[2].frame_from_zone, Similarity3::identity());
    let refused = joined.pairs.iter().filter(|p| p.result.is_err());
    assert!(refused.count() >= 1);
}

/// A guess that is right to 10 cm and 2 % of scale is refined, scale and all.
#[test]
fn a_guess_with_scale_is_refined() {
    let room = Room::random(Vector3::new(7.0, 6.0, 3.0), 4.0, 3);
    let scans = [1, 2].map(|seed| whole(&room, 40_000, seed));
    let mut frame = random_frame(&mut Rng::new(1));
    frame.prepend_scaling_mut(2.0);
    let double = moved(&scans[1], &frame);
    let zones = [zone(&scans[0]), Zone::new(&double.cloud, &double.viewpoints, 0.1).unwrap()];
    let truth = frame.inverse();
    let slip =
        Similarity3::new(Vector3::new(0.06, -0.05, 0.05), Vector3::new(0.01, 0.02, 0.01), 1.02);
    let guess = Guess { source: 1, target: 0, target_from_source: slip * truth };
    let options = NearbyOptions { motion: crate::Motion::Similarity, ..Default::default() };
    let joined = join_zones(&zones, &[guess], &options, &NoProgress).unwrap();
    let found = joined.placements[1].frame_from_zone;
    assert_eq!(joined.placements[1].reference, 0);
    let (shift, turn) = off(&found, &truth, &zones[1].surfels().center());
    assert!(shift < 0.002 && turn.to_degrees() < 0.03, "{shift} {turn}");
    assert!((found.scaling() / truth.scaling() - 1.0).abs() < 5e-4);
}

#[test]
fn a_wrong_guess_joins_nothing() {
    let (zones, _) = hall([2, 1], [10.0, 6.0], 1);
    let wrong = Guess { source: 1, target: 0, target_from_source: random_frame(&mut Rng::new(9)) };
    let report = join_zones(&zones, &[wrong], &NearbyOptions::default(), &NoProgress).unwrap();
    assert!(!report.pairs[0].is_used && report.pairs[0].result.is_err());
    let nowhere = Guess { source: 7, ..wrong };
    assert!(join_zones(&[], &[nowhere], &NearbyOptions::default(), &NoProgress).is_ok());
}

#[test]
fn it_stops_when_asked() {
    struct Stop;
    impl Progress for Stop {
        fn report(&self, _stage: Stage, _done: usize, _total: usize) {}
        fn is_cancelled(&self) -> bool {
            true
        }
    }
    let (zones, _) = hall([2, 1], [10.0, 6.0], 1);
    let stopped = join_zones(&zones, &[], &NearbyOptions::default(), &Stop);
    assert_eq!(stopped, Err(RegistrationError::Cancelled(Cancelled)));
}
