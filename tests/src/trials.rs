//! Trials of the verdict: rooms, flights and troubles drawn from a seed, with exact poses.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::{Isometry3, Point3, Vector3};
use volery_geometry::{Camera, CameraModel};
use volery_scene::{TwoViewGeometry, Verdict};
use volery_sfm::Reconstruction;
use volery_synthetic::{
    CenterMotion, Cuboid, PointOptions, PointScene, Rng, Room, along_wall, circle, random_walk,
    ring, yaw_scan,
};

use crate::Evaluation;
use crate::scans::{Knowledge, judge, map_pairs, verified_pairs};

/// What a scene puts a mapper through.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Trial {
    /// Around the middle of a room, looking inward.
    Loop,
    /// Sideways along a wall.
    WallRun,
    /// Down a corridor and back, looking ahead both ways.
    OutAndBack,
    /// Three stations, a turn on the spot at each.
    Stations,
    /// A walk of which each image is matched with the next three only.
    SequenceOnly,
    /// Opposite walls that look alike.
    Doppelganger,
    /// A tenth of the usual texture.
    LowTexture,
    /// Steps so wide that neighbors hardly overlap.
    NarrowOverlap,
    /// A focal length a third off, to be found.
    WrongFocal,
    /// A given focal length that is 3 % off and believed.
    WrongCalibration,
    /// Half of the matches wrong, and pairs of images that share nothing verified all the same.
    MixedPairs,
}

impl Trial {
    /// All of them.
    pub const ALL: [Self; 11] = [
        Self::Loop,
        Self::WallRun,
        Self::OutAndBack,
        Self::Stations,
        Self::SequenceOnly,
        Self::Doppelganger,
        Self::LowTexture,
        Self::NarrowOverlap,
        Self::WrongFocal,
        Self::WrongCalibration,
        Self::MixedPairs,
    ];

    /// Whether the flight keeps to the advice on capture. A map of the others may be right and
    /// yet hang by little: to doubt it is no fault.
    pub fn is_well_flown(self) -> bool {
        !matches!(self, Self::SequenceOnly | Self::NarrowOverlap | Self::Doppelganger)
    }
}

/// How a trial ended.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The map and its verdict.
    pub reconstruction: Reconstruction,
    /// Its errors; `None` without a map.
    pub figures: Option<Evaluation>,
    /// Length by which the flight is judged, meters: the diagonal of the box around its cameras,
    /// or, of a flight about one spot, the distance of what it sees.
    pub extent: f64,
}

impl Outcome {
    /// Off by more than 1 % of the extent, or half a degree.
    pub fn is_wrong(&self) -> bool {
        self.figures.is_none_or(|f| f.ate_rmse > 0.01 * self.extent || f.rotation_median_deg > 0.5)
    }

    /// Whether the verdict says so.
    pub fn is_called_good(&self) -> bool {
        self.reconstruction.quality.verdict == Verdict::Good
    }
}

/// Draws the scene of `trial` from `seed` and maps it.
pub fn run(trial: Trial, seed: u64) -> Outcome {
    let mut rng = Rng::fork(seed, 0x7472 + trial as u64);
    let room = if trial == Trial::OutAndBack { corridor(&mut rng) } else { furnished(&mut rng) };
    let poses = flight(trial, &room, &mut rng);
    let focal = rng.range(420.0, 560.0);
    let camera = Camera::from_focal(CameraModel::SimpleRadial, 640, 480, focal)
        .expect("a focal length of that size is valid");
    let usual = PointOptions {
        num_points: 6000,
        noise_px: rng.range(0.3, 0.9),
        wrong_fraction: rng.range(0.0, 0.2),
        ..PointOptions::default()
    };
    let options = match trial {
        Trial::LowTexture => PointOptions { num_points: 600, ..usual },
        Trial::Doppelganger => PointOptions { repeated_fraction: 0.6, ..usual },
        Trial::MixedPairs => PointOptions { wrong_fraction: 0.5, ..usual },
        _ => usual,
    };
    let scene = PointScene::observe(&room, &camera, poses, &options, seed);
    let knowledge = match trial {
        Trial::WrongFocal => Knowledge::Guess(focal * 1.33),
        Trial::WrongCalibration => Knowledge::Fixed(focal * 1.03),
        _ => Knowledge::Fixed(focal),
    };
    let mut pairs = verified_pairs(&scene, knowledge, seed);
    match trial {
        Trial::SequenceOnly => pairs.retain(|pair| pair.image2.0 - pair.image1.0 <= 3),
        Trial::MixedPairs => mix(&mut pairs, &mut rng),
        _ => {}
    }
    let reconstruction =
        map_pairs(&scene, knowledge, &pairs, seed).expect("the scene has images and a camera");
    let figures = judge(&scene, &reconstruction);
    Outcome { reconstruction, figures, extent: extent(&scene) }
}

/// A room of 5 to 10 m with a few boxes along its walls.
fn furnished(rng: &mut Rng) -> Room {
    let size = Vector3::new(rng.range(6.0, 10.0), rng.range(5.0, 8.0), rng.range(2.6, 3.6));
    let furniture = (0..8)
        .map(|i| {
            let along = rng.range(-0.4, 0.4);
            let [x, y] = match i % 4 {
                0 => [along * size.x, 0.5 * size.y - 0.5],
                1 => [along * size.x, 0.5 - 0.5 * size.y],
                2 => [0.5 * size.x - 0.5, along * size.y],
                _ => [0.5 - 0.5 * size.x, along * size.y],
            };
            let edges = Vector3::new(rng.range(0.4, 0.9), rng.range(0.4, 0.9), rng.range(0.5, 2.2));
            Cuboid::standing(x, y, 0.0, edges, rng.range(-0.4, 0.4))
        })
        .collect();
    Room { size, furniture }
}

/// 3 m wide, 12 to 18 m long.
fn corridor(rng: &mut Rng) -> Room {
    let length = rng.range(12.0, 18.0);
    let furniture = (0..6)
        .map(|i| {
            let y = length * (f64::from(i) / 6.0 - 0.4);
            let side = if i % 2 == 0 { 1.25 } else { -1.25 };
            let edges = Vector3::new(0.4, rng.range(0.4, 1.2), rng.range(0.8, 2.0));
            Cuboid::standing(side, y, 0.0, edges, 0.0)
        })
        .collect();
    Room { size: Vector3::new(3.0, length, 2.8), furniture }
}

fn flight(trial: Trial, room: &Room, rng: &mut Rng) -> Vec<Isometry3<f64>> {
    let seed = rng.bits();
    let middle = Point3::new(rng.range(-0.4, 0.4), rng.range(-0.4, 0.4), rng.range(1.2, 1.7));
    match trial {
        Trial::Loop => ring(&middle, rng.range(1.0, 1.6), 20 + rng.index(20), seed),
        Trial::Doppelganger => ring(&middle, rng.range(1.0, 1.6), 24 + rng.index(16), seed),
        Trial::WallRun => {
            let start = Point3::new(-0.3 * room.size.x, -0.5, middle.z);
            let num_views = 10 + rng.index(10);
            along_wall(&start, 0.0, 0.6 * room.size.x / num_views as f64, num_views, seed)
        }
        Trial::OutAndBack => {
            let (from, to) = (-0.45 * room.size.y, 0.4 * room.size.y);
            let num_views = 30;
            let at = |i: usize| from + (to - from) * i as f64 / (num_views - 1) as f64;
            let place = |i: usize, yaw: f64, rng: &mut Rng| {
                let drift = 0.05 * rng.normal3();
                let center = Point3::new(0.1, at(i), 1.4) + drift;
                volery_synthetic::cam_from_heading(&center, yaw + 0.1 * rng.normal(), 0.0, 0.0)
            };
            let mut poses: Vec<_> = (0..num_views).map(|i| place(i, 0.0, rng)).collect();
            // It turns at the far end.
            let far = num_views - 1;
            poses.extend((1..12).map(|k| place(far, TAU / 24.0 * f64::from(k), rng)));
            poses.extend((0..num_views).rev().map(|i| place(i, TAU / 2.0, rng)));
            poses
        }
        Trial::Stations => {
            let motion = CenterMotion::Wobble { sigma: rng.range(0.02, 0.08) };
            (0..3)
                .flat_map(|station| {
                    let shift = Vector3::new(f64::from(station) - 1.0, 0.3 * rng.normal(), 0.0);
                    yaw_scan(&(middle + shift), 24, TAU / 24.0, motion, seed ^ station as u64)
                })
                .collect()
        }
        Trial::SequenceOnly => random_walk(room, rng.range(0.12, 0.25), 40, seed),
        Trial::LowTexture | Trial::MixedPairs | Trial::WrongFocal | Trial::WrongCalibration => {
            if rng.chance(0.5) {
                ring(&middle, rng.range(1.0, 1.6), 24, seed)
            } else {
                random_walk(room, 0.2, 30, seed)
            }
        }
        Trial::NarrowOverlap => {
            if rng.chance(0.5) {
                circle(&middle, rng.range(0.2, 1.0), 9 + rng.index(9), seed)
            } else {
                let spacing = rng.range(0.8, 1.6);
                let start = Point3::new(-0.35 * room.size.x, 0.0, middle.z);
                let num_views = (0.7 * room.size.x / spacing) as usize + 1;
                along_wall(&start, FRAC_PI_2 * rng.index(2) as f64, spacing, num_views, seed)
            }
        }
    }
}

/// Pairs of far images that claim the geometry of others.
fn mix(pairs: &mut [TwoViewGeometry], rng: &mut Rng) {
    let n = pairs.len();
    for _ in 0..n / 10 {
        let (a, b) = (rng.index(n), rng.index(n));
        let foreign = pairs[b].clone();
        let (image1, image2) = (pairs[a].image1, pairs[a].image2);
        pairs[a] = TwoViewGeometry { image1, image2, ..foreign };
    }
}

fn extent(scene: &PointScene) -> f64 {
    let centers: Vec<Point3<f64>> =
        scene.cam_from_world.iter().map(|pose| pose.inverse() * Point3::origin()).collect();
    let (mut low, mut high) = (centers[0], centers[0]);
    for center in &centers {
        low = low.inf(center);
        high = high.sup(center);
    }
    let mut distances: Vec<f64> = Vec::new();
    for (center, seen) in centers.iter().zip(&scene.point_of_keypoint) {
        distances.extend(seen.iter().map(|&point| (scene.points[point] - center).norm()));
    }
    (high - low).norm().max(crate::evaluation::median(&distances))
}
