//! Rotation averaging, triplets and positioning on small graphs.

use nalgebra::{Point3, Unit, UnitQuaternion, Vector3};
use volery_geometry::similarity_from_points;
use volery_synthetic::Rng;

use crate::global::{
    PositioningOptions, Positions, RayObservation, RotationEdge, average_rotations,
    position_globally, weigh_by_triplets,
};

fn random_rotation(rng: &mut Rng) -> UnitQuaternion<f64> {
    UnitQuaternion::from_scaled_axis(rng.normal3() * 1.5)
}

/// Every image with the next five; every tenth edge is wrong.
fn graph(n: usize, rng: &mut Rng) -> (Vec<UnitQuaternion<f64>>, Vec<RotationEdge>, Vec<bool>) {
    let truth: Vec<_> = (0..n).map(|_| random_rotation(rng)).collect();
    let (mut edges, mut is_wrong) = (Vec::new(), Vec::new());
    for i in 0..n {
        for j in i + 1..(i + 6).min(n) {
            let wrong = edges.len() % 10 == 7;
            let spoiled = if wrong { random_rotation(rng) } else { UnitQuaternion::identity() };
            let j_from_i = spoiled * truth[j] * truth[i].inverse();
            edges.push(RotationEdge { i, j, j_from_i, weight: 1.0 + (i % 3) as f64 });
            is_wrong.push(wrong && spoiled.angle() > 0.3);
        }
    }
    (truth, edges, is_wrong)
}

/// Exact edges among wrong ones give the exact rotations, and the wrong ones stand out.
#[test]
fn wrong_edges_do_not_bend_the_average() {
    let mut rng = Rng::fork(3, 0);
    let (truth, edges, is_wrong) = graph(30, &mut rng);
    let average = average_rotations(30, &edges, &[]);
    let world = truth[0].inverse() * average.cam_from_world[0].unwrap();
    for (found, truth) in average.cam_from_world.iter().zip(&truth) {
        assert!(found.unwrap().angle_to(&(truth * world)) < 1e-3);
    }
    for (residual, wrong) in average.residuals.iter().zip(is_wrong) {
        assert!(if wrong { *residual > 0.17 } else { *residual < 0.01 }, "{residual} {wrong}");
    }
}

/// Known ups make the world upright.
#[test]
fn gravity_makes_upright() {
    let mut rng = Rng::fork(4, 0);
    let (truth, mut edges, is_wrong) = graph(12, &mut rng);
    let mut wrong = is_wrong.into_iter();
    edges.retain(|_| !wrong.next().unwrap());
    let up = |rotation: &UnitQuaternion<f64>| Unit::new_normalize(rotation * Vector3::z());
    let ups: Vec<_> = truth
        .iter()
        .enumerate()
        .map(|(image, rotation)| (image % 2 == 0).then(|| (up(rotation), 0.01)))
        .collect();
    let average = average_rotations(12, &edges, &ups);
    for (found, truth) in average.cam_from_world.iter().zip(&truth) {
        assert!(up(&found.unwrap()).angle(&up(truth)) < 1e-3);
    }
}

#[test]
fn only_the_largest_component_gets_rotations() {
    let edge = |i, j| RotationEdge { i, j, j_from_i: UnitQuaternion::identity(), weight: 1.0 };
    let average = average_rotations(6, &[edge(0, 1), edge(2, 3), edge(3, 4)], &[]);
    let has: Vec<bool> = average.cam_from_world.iter().map(Option::is_some).collect();
    assert_eq!(has, [false, false, true, true, true, false]);
    assert_eq!(average.residuals[0], f64::INFINITY);
    assert!(average_rotations(3, &[], &[]).cam_from_world.iter().all(Option::is_none));
    assert_eq!(average_rotations(3, &[edge(0, 0), edge(1, 9)], &[]).residuals.len(), 2);
}

#[test]
fn triplets_find_the_wrong_edges() {
    let mut rng = Rng::fork(5, 0);
    let (_, mut edges, is_wrong) = graph(20, &mut rng);
    edges.iter_mut().for_each(|edge| edge.weight = 1.0);
    weigh_by_triplets(20, &mut edges);
    let mean = |wrong: bool| {
        let of: Vec<f64> = edges
            .iter()
            .zip(&is_wrong)
            .filter(|(_, w)| **w == wrong)
            .map(|(edge, _)| edge.weight)
            .collect();
        of.iter().sum::<f64>() / of.len() as f64
    };
    assert!(mean(true) < 0.05 && mean(false) > 0.4, "{} {}", mean(true), mean(false));
}

/// Exact rays, one track in five wrong: centers come home from anywhere.
#[test]
fn positions_come_home_from_random_starts() {
    let mut rng = Rng::fork(6, 0);
    let centers: Vec<Point3<f64>> = (0..12).map(|_| Point3::from(rng.normal3() * 2.0)).collect();
    let mut observations = Vec::new();
    for point in 0..150 {
        let x = Point3::from(rng.normal3() * 4.0);
        for (image, center) in centers.iter().enumerate() {
            let is_wrong = point % 5 == 0 && image % 3 == 0;
            let ray = if is_wrong { rng.normal3() } else { x - center };
            if rng.chance(0.5) {
                let ray_in_world = Unit::new_normalize(ray);
                observations.push(RayObservation { image, point, ray_in_world });
            }
        }
    }
    let mut any = |n: usize| (0..n).map(|_| Point3::from(rng.normal3())).collect::<Vec<_>>();
    let best = (0..3)
        .map(|_| {
            let mut positions = Positions { centers: any(12), points: any(150) };
            let cost =
                position_globally(&mut positions, &observations, &PositioningOptions::default());
            (cost, positions)
        })
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .unwrap();
    let truth_from_found = similarity_from_points(&best.1.centers, &centers).unwrap();
    for (found, truth) in best.1.centers.iter().zip(&centers) {
        let error = (truth_from_found * found - truth).norm();
        assert!(error < 0.1, "{error} of a spread of 2");
    }
}
