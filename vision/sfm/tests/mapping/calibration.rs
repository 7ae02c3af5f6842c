//! Calibrations that the photos contradict.

use nalgebra::Point3;
use volery_geometry::{Camera, CameraModel};
use volery_scene::{CameraId, NoProgress, Verdict};
use volery_sfm::quality::calibration::calibration_shift;
use volery_synthetic::{PointScene, Room, circle, ring};

use super::observed::{camera, fixed, map, options, pose_errors};

/// A calibration is doubted for what it does to the map: 6 % of the focal length turn the ends of
/// a half circle by degrees and hardly move a ring that looks at its middle.
#[test]
fn a_calibration_is_doubted_for_what_it_bends() {
    let mut half_circle = circle(&Point3::new(0.3, -0.2, 1.5), 0.5, 24, 22);
    half_circle.truncate(12);
    let whole_ring = ring(&Point3::new(0.0, 0.0, 1.5), 1.6, 24, 1);
    for (poses, factor, is_bent) in
        [(&half_circle, 1.0, false), (&half_circle, 1.06, true), (&whole_ring, 1.06, false)]
    {
        let scene = PointScene::observe(&Room::standard(), &camera(), poses.clone(), &options(), 1);
        let given =
            Camera::from_focal(CameraModel::SimpleRadial, 640, 480, 460.0 * factor).unwrap();
        let found = map(&scene, fixed(given));
        let (position, rotation) = pose_errors(&found.models[0], &scene);
        assert_eq!(position > 0.05 || rotation > 1.0, is_bent, "{position} m, {rotation} degrees");
        let codes: Vec<_> = found.quality.reasons.iter().map(|r| r.code.as_str()).collect();
        assert_eq!(codes.contains(&"wrong_calibration"), is_bent, "{factor}: {codes:?}");
        let shift = calibration_shift(&found.models[0], CameraId(0), &NoProgress).unwrap().unwrap();
        // Two values are free: chance makes it 4 in one of 3000 scenes.
        assert_eq!(shift.num_sigmas < 4.0, factor == 1.0, "{factor}: {shift:?}");
    }
}

/// A lens given as free of distortion bends the map as well.
#[test]
fn a_missing_distortion_is_a_wrong_calibration() {
    let truth =
        Camera::new(CameraModel::SimpleRadial, 640, 480, &[460.0, 320.0, 240.0, -0.1]).unwrap();
    let poses = ring(&Point3::new(0.0, 0.0, 1.5), 1.6, 24, 2);
    let scene = PointScene::observe(&Room::standard(), &truth, poses, &options(), 2);
    let given = Camera::from_focal(CameraModel::SimplePinhole, 640, 480, 460.0).unwrap();
    let found = map(&scene, fixed(given));
    assert_ne!(found.quality.verdict, Verdict::Good);
    let codes: Vec<_> = found.quality.reasons.iter().map(|r| r.code.as_str()).collect();
    assert!(codes.contains(&"wrong_calibration"), "{codes:?}");
}
