use nalgebra::{Isometry3, Point2, Vector3};
use volery_geometry::Rng;
use volery_scene::{CameraId, Observation, Point3d, RegisteredImage};

use super::*;

/// A map of the given points, which two images from (0, 0, -4) see; keypoint i is point i.
fn map(points: &[Point3<f64>]) -> SparseModel {
    let mut model = SparseModel::default();
    let num = points.len();
    for image in [0, 1].map(ImageId) {
        model.images.insert(
            image,
            RegisteredImage {
                name: format!("{}.jpg", image.0),
                camera: CameraId(0),
                cam_from_world: Isometry3::translation(0.1 * f64::from(image.0), 0.0, 4.0),
                keypoints: vec![Point2::origin(); num],
                points: (0..num as u32).map(|i| Some(PointId(i.into()))).collect(),
            },
        );
    }
    for (i, &position) in points.iter().enumerate() {
        let keypoint = i as u32;
        let track = [0, 1].map(|k| Observation { image: ImageId(k), keypoint }).to_vec();
        let point = Point3d { position, color: [0; 3], error_px: 0.5, track };
        model.points.insert(PointId(keypoint.into()), point);
    }
    model
}

fn matches(pairs: impl Iterator<Item = (usize, usize)>) -> Vec<CrossMatches> {
    let to_match = |(a, b)| FeatureMatch { feature1: a as u32, feature2: b as u32 };
    let matches: Vec<FeatureMatch> = pairs.map(to_match).collect();
    vec![CrossMatches { source: ImageId(0), target: ImageId(1), matches }]
}

fn spread(rng: &mut Rng, n: usize) -> Vec<Point3<f64>> {
    (0..n).map(|_| Point3::from(rng.normal3() * 1.5)).collect()
}

/// P53: two maps in frames and units of their own, 40 of 200 matches right.
#[test]
fn a_fifth_of_right_matches_is_enough() {
    let truth = Similarity3::new(Vector3::new(3.0, -1.0, 0.5), Vector3::new(0.2, 2.0, -0.4), 1.7);
    let mut normalized = Vec::new();
    for seed in 0..10 {
        let mut rng = Rng::new(seed);
        let source = spread(&mut rng, 200);
        let target: Vec<_> = source.iter().map(|p| truth * p + rng.normal3() * 0.01).collect();
        let shuffled = (0..200).map(|i| (i, if i < 40 { i } else { rng.index(200) }));
        let matches = matches(shuffled.collect::<Vec<_>>().into_iter());
        let found =
            align_shared_points(&map(&source), &map(&target), &matches, Motion::Similarity, seed)
                .unwrap();
        assert!(found.points.len() >= 38, "{}", found.points.len());
        assert!(found.points.iter().filter(|(s, t)| s == t).count() >= 38);
        let error = found.target_from_source * truth.inverse();
        assert!((error.scaling() - 1.0).abs() < 5e-3);
        assert!(error.isometry.rotation.angle() < 5e-3);
        let c = found.constraint.center;
        let moved = error * c - c;
        let covariance = found.constraint.covariance().unwrap();
        normalized.push(moved.norm_squared() / covariance.fixed_view::<3, 3>(3, 3).trace());
    }
    // χ² of three degrees over its mean: one on average, here of ten draws.
    let mean = normalized.iter().sum::<f64>() / 10.0;
    assert!((0.3..2.5).contains(&mean), "{mean}");
}

/// Maps of one unit keep it; maps of two units are not one without their scale.
#[test]
fn without_scale_the_unit_stays() {
    let mut rng = Rng::new(3);
    let source = spread(&mut rng, 100);
    let all = matches((0..100).map(|i| (i, i)));
    for (scale, is_found) in [(1.0, true), (1.5, false)] {
        let truth = Similarity3::new(Vector3::new(1.0, 2.0, 0.5), Vector3::z(), scale);
        let target: Vec<_> = source.iter().map(|p| truth * p + rng.normal3() * 0.01).collect();
        let (source, target) = (map(&source), map(&target));
        let found = align_shared_points(&source, &target, &all, Motion::Rigid, 0);
        let Ok(found) = found else {
            assert!(!is_found, "{found:?}");
            continue;
        };
        assert!(is_found && found.points.len() >= 95);
        assert_eq!(found.target_from_source.scaling(), 1.0);
        let error = found.target_from_source.isometry * truth.isometry.inverse();
        assert!(error.translation.vector.norm() < 5e-3 && error.rotation.angle() < 5e-3);
        let again = agreeing_points(&source, &target, &all, &found.target_from_source);
        assert_eq!(again, found.points);
    }
}

#[test]
fn rooms_without_common_points_are_told_apart() {
    for seed in 0..10 {
        let mut rng = Rng::new(seed);
        let (source, target) = (spread(&mut rng, 300), spread(&mut rng, 300));
        let all = matches((0..300).map(|i| (i, i)));
        let found =
            align_shared_points(&map(&source), &map(&target), &all, Motion::Similarity, seed);
        assert!(matches!(found, Err(RegistrationError::NoOverlap { .. })), "{found:?}");
    }
    let empty = map(&[]);
    let none = align_shared_points(&empty, &empty, &[], Motion::Similarity, 0).unwrap_err();
    assert_eq!(none.code(), "no_overlap");
}

/// Fifty points of one poster, 40 cm wide, 4 m away.
#[test]
fn a_poster_is_no_overlap() {
    let mut rng = Rng::new(1);
    let poster: Vec<_> =
        (0..50).map(|_| Point3::new(rng.range(-0.2, 0.2), rng.range(-0.3, 0.3), 0.0)).collect();
    let all = matches((0..50).map(|i| (i, i)));
    let found =
        align_shared_points(&map(&poster), &map(&poster), &all, Motion::Similarity, 1).unwrap_err();
    assert_eq!(found.code(), "underconstrained");
}

#[test]
fn points_are_paired_once_by_votes() {
    let mut rng = Rng::new(2);
    let model = map(&spread(&mut rng, 10));
    let mut votes = matches([(0, 0), (1, 1), (2, 5), (9, 9)].into_iter());
    votes.extend(matches([(0, 3), (2, 5), (1, 1), (99, 0)].into_iter()));
    votes.push(CrossMatches { source: ImageId(7), ..votes[0].clone() });
    let pairs = shared_points(&model, &model, &votes);
    let ids = [(0, 0), (1, 1), (2, 5), (9, 9)].map(|(s, t)| (PointId(s), PointId(t)));
    assert_eq!(pairs, ids);
}
