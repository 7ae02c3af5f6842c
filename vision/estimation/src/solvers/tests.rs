use nalgebra::{Isometry3, Matrix3, Point2, Point3, Vector3};
use volery_geometry::Rng;
use volery_geometry::epipolar::{essential_from_pose, squared_sampson_error};

use super::*;
use crate::test_scene::{pose, room_point};

/// A random motion with n points in front of both cameras, as seen by each.
fn motion<const N: usize>(
    random: &mut Rng,
) -> (Isometry3<f64>, [Vector3<f64>; N], [Vector3<f64>; N]) {
    loop {
        let center = random.normal3() * 0.5;
        let motion = pose(center, random.range(-0.3, 0.3), 0.1, random.range(-0.3, 0.3));
        let mut seen = Vec::new();
        for _ in 0..1000 {
            // Not on walls: six points of one plane leave F open.
            let p = Point3::new(
                random.range(-2.0, 2.0),
                random.range(-2.0, 2.0),
                random.range(1.0, 5.0),
            );
            if p.z > 0.5 && (motion * p).z > 0.5 && seen.len() < N {
                seen.push(p);
            }
        }
        if seen.len() == N {
            let x1 = std::array::from_fn(|i| seen[i].coords / seen[i].z);
            let x2 = std::array::from_fn(|i| {
                let p = motion * seen[i];
                p.coords / p.z
            });
            return (motion, x1, x2);
        }
    }
}

fn unit_distance(a: &Matrix3<f64>, b: &Matrix3<f64>) -> f64 {
    let (a, b) = (a.normalize(), b.normalize());
    (a - b).norm().min((a + b).norm())
}

fn flat<const N: usize>(x: &[Vector3<f64>; N]) -> [Point2<f64>; N] {
    x.map(|x| Point2::new(x.x / x.z, x.y / x.z))
}

/// Every solution satisfies the five equations and the cubic constraints, and one is the truth.
#[test]
fn five_points_give_the_essential_matrix() {
    let mut missed = 0;
    for seed in 0..500 {
        let (truth, x1, x2) = motion::<5>(&mut Rng::new(seed));
        let solutions = relpose_5pt(&x1, &x2);
        let e = essential_from_pose(&truth);
        missed += usize::from(!solutions.iter().any(|s| unit_distance(s, &e) < 1e-5));
        for s in &solutions {
            let gram = s * s.transpose();
            let cubic = gram * s * 2.0 - s * gram.trace();
            assert!(s.determinant().abs() < 1e-4 && cubic.norm() < 1e-3, "seed {seed}");
        }
    }
    assert!(missed <= 2, "{missed} of 500 missed");
}

/// P20: seven points leave up to three, eight and more leave one.
#[test]
fn seven_and_eight_points_give_the_fundamental_matrix() {
    for seed in 0..200 {
        let (truth, x1, x2) = motion::<7>(&mut Rng::new(seed));
        let e = essential_from_pose(&truth);
        let solutions = fundamental_7pt(&flat(&x1), &flat(&x2));
        let nearest = solutions.iter().map(|f| unit_distance(f, &e)).fold(9.0, f64::min);
        assert!(nearest < 1e-5, "seed {seed}: {nearest}");
        assert!(solutions.iter().all(|f| f.determinant().abs() < 1e-9));

        let (truth, x1, x2) = motion::<12>(&mut Rng::new(seed));
        // In pixels: without Hartley's normalization this loses its digits.
        let pixels = |x: &[Vector3<f64>; 12]| {
            flat(x).map(|p| Point2::from(p.coords * 900.0 + nalgebra::Vector2::new(640.0, 480.0)))
        };
        let (p1, p2) = (pixels(&x1), pixels(&x2));
        let f = fundamental_8pt(&p1, &p2).unwrap();
        for (a, b) in p1.iter().zip(&p2) {
            assert!(squared_sampson_error(&f, a, b) < 1e-8, "seed {seed}");
        }
        let k = Matrix3::new(900.0, 0.0, 640.0, 0.0, 900.0, 480.0, 0.0, 0.0, 1.0);
        let distance = unit_distance(&(k.transpose() * f * k), &essential_from_pose(&truth));
        assert!(distance < 1e-4, "seed {seed}: {distance}");
    }
    assert_eq!(fundamental_8pt(&[Point2::origin(); 7], &[Point2::origin(); 7]), None);
    assert_eq!(fundamental_8pt(&[Point2::origin(); 9], &[Point2::origin(); 9]), None);
}

#[test]
fn four_points_give_the_homography() {
    let mut random = Rng::new(3);
    for _ in 0..200 {
        let h = Matrix3::identity() + Matrix3::from_fn(|_, _| random.range(-0.2, 0.2));
        let x1: [Vector3<f64>; 4] = [(-1.0, -1.0), (1.0, -0.8), (0.9, 1.1), (-1.2, 0.7)]
            .map(|(x, y)| Vector3::new(x + random.range(-0.2, 0.2), y, 1.0));
        let x2 = x1.map(|x| h * x);
        assert!(unit_distance(&homography_4pt(&x1, &x2).unwrap(), &h) < 1e-9);
        assert!(unit_distance(&homography_dlt(&flat(&x1), &flat(&x2)).unwrap(), &h) < 1e-6);
    }
    let line = [0.0, 1.0, 2.0, 3.0].map(|t| Vector3::new(t, 2.0 * t, 1.0));
    assert_eq!(homography_4pt(&line, &line), None);
    assert_eq!(homography_dlt(&[Point2::origin(); 3], &[Point2::origin(); 3]), None);
}

#[test]
fn two_rays_give_the_rotation() {
    let mut random = Rng::new(8);
    for _ in 0..100 {
        let truth = nalgebra::Rotation3::new(random.normal3());
        let b1: [Vector3<f64>; 2] = std::array::from_fn(|_| random.normal3().normalize());
        let found = rotation_2pt(&b1, &b1.map(|b| truth * b)).unwrap();
        assert!((found.matrix() - truth.matrix()).norm() < 1e-7);
        let many = rotation_from_bearings(b1.iter().map(|b| (*b, truth * b, 2.0))).unwrap();
        let many = many.to_rotation_matrix();
        assert!((many.matrix() - truth.matrix()).norm() < 1e-7, "{many} {truth}");
    }
    let x = Vector3::x();
    assert!(rotation_2pt(&[x, x], &[x, x]).is_none());
    assert!(rotation_from_bearings([(x, x, 1.0)].into_iter()).is_none());
}

/// Every pose reproduces the three rays, and one is the truth.
#[test]
fn three_points_give_the_pose() {
    let mut missed = 0;
    for seed in 0..2000 {
        let mut random = Rng::new(seed);
        let truth = pose(random.normal3(), random.range(-3.0, 3.0), 0.3, 0.2);
        let points: [Point3<f64>; 3] = std::array::from_fn(|_| {
            loop {
                let p = room_point(&mut random);
                if (truth * p).z > 0.3 {
                    break p;
                }
            }
        });
        let bearings = points.map(|p| (truth * p).coords.normalize());
        let solutions = p3p(&bearings, &points);
        for s in &solutions {
            for (b, p) in bearings.iter().zip(&points) {
                assert!(((s * p).coords.normalize() - b).norm() < 1e-6, "seed {seed}");
            }
        }
        missed += usize::from(
            !solutions.iter().any(|s| (s.to_homogeneous() - truth.to_homogeneous()).norm() < 1e-5),
        );
    }
    assert!(missed <= 4, "{missed} of 2000 missed");
}

#[test]
fn degenerate_triples_have_no_pose() {
    let z = Vector3::z();
    let line = [0.0, 1.0, 2.0].map(|t| Point3::new(t, 0.0, 4.0));
    let rays = line.map(|p| p.coords.normalize());
    assert!(p3p(&rays, &line).is_empty());
    assert!(p3p(&[z, z, z], &[Point3::origin(); 3]).is_empty());
    let nan = Point3::new(f64::NAN, 0.0, 0.0);
    assert!(p3p(&[z, z, z], &[nan, line[0], line[1]]).is_empty());
}
