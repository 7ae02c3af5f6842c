use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point2, Point3, Translation3, UnitQuaternion};
use volery_geometry::{Camera, CameraModel};
use volery_scene::{
    CameraId, ImageId, Observation, Point3d, PointId, RegisteredImage, SparseModel,
};

use super::*;

/// Two cameras, three images (one without keypoints), three points, ids with gaps.
pub(crate) fn model() -> SparseModel {
    let mut model = SparseModel::default();
    let pinhole = Camera::new(CameraModel::Pinhole, 640, 480, &[500.0, 501.0, 320.0, 240.0]);
    let opencv = [1200.5, 1201.5, 800.25, 601.0, -0.1, 0.05, 0.001, -1e-17];
    model.cameras.insert(CameraId(0), pinhole.unwrap());
    model
        .cameras
        .insert(CameraId(7), Camera::new(CameraModel::OpenCv, 1600, 1202, &opencv).unwrap());
    let image = |name: &str, camera, angle: f64, points: &[Option<u64>]| RegisteredImage {
        name: name.into(),
        camera: CameraId(camera),
        cam_from_world: Isometry3::from_parts(
            Translation3::new(0.1 * angle, -2.0, 1.0 / 3.0),
            UnitQuaternion::from_euler_angles(angle, 0.3, -1.1),
        ),
        keypoints: (0..points.len()).map(|i| Point2::new(i as f64 + 0.1, 100.7)).collect(),
        points: points.iter().map(|point| point.map(PointId)).collect(),
    };
    model.images.insert(ImageId(0), image("a b.jpg", 0, 0.5, &[Some(4), None, Some(9)]));
    model.images.insert(ImageId(3), image("c.jpg", 7, 1.5, &[None, Some(9), Some(4)]));
    model.images.insert(ImageId(5), image("empty.jpg", 7, 2.5, &[]));
    let point = |x: f64, track: &[(u32, u32)]| Point3d {
        position: Point3::new(x, 1e-9, -7.25),
        color: [1, 2, 255],
        error_px: 0.1 + x,
        track: track
            .iter()
            .map(|&(image, keypoint)| Observation { image: ImageId(image), keypoint })
            .collect(),
    };
    model.points = BTreeMap::from([
        (PointId(4), point(0.3, &[(0, 0), (3, 2)])),
        (PointId(9), point(1.0 / 7.0, &[(0, 2), (3, 1)])),
        (PointId(1 << 40), point(5.0, &[])),
    ]);
    model
}

/// Rotations are normalized on reading, which may change their last bit; all else is exact.
fn assert_same(a: &SparseModel, b: &SparseModel) {
    assert_eq!(a.cameras, b.cameras);
    assert_eq!(a.points, b.points);
    assert_eq!(a.images.len(), b.images.len());
    for (id, image) in &a.images {
        let other = &b.images[id];
        assert!(
            (image.cam_from_world.to_homogeneous() - other.cam_from_world.to_homogeneous()).amax()
                < 1e-15
        );
        let aligned = RegisteredImage { cam_from_world: image.cam_from_world, ..other.clone() };
        assert_eq!(*image, aligned);
    }
}

#[test]
fn round_trips() {
    let model = model();
    assert_same(&model, &read_colmap_text(&write_colmap_text(&model)).unwrap());
    assert_same(&model, &read_colmap_binary(&write_colmap_binary(&model)).unwrap());
    let empty = SparseModel::default();
    assert_same(&empty, &read_colmap_text(&write_colmap_text(&empty)).unwrap());
    assert_same(&empty, &read_colmap_binary(&write_colmap_binary(&empty)).unwrap());
}

fn parts(files: &mut ColmapFiles) -> [&mut Vec<u8>; 3] {
    [&mut files.cameras, &mut files.images, &mut files.points]
}

/// Poses come without the points, whatever state those are in.
#[test]
fn poses_come_alone() {
    let model = model();
    for (mut files, is_binary) in
        [(write_colmap_text(&model), false), (write_colmap_binary(&model), true)]
    {
        files.points = b"nonsense".to_vec();
        let poses = read_colmap_poses(&files, is_binary).unwrap();
        assert_eq!(poses.cameras, model.cameras);
        assert!(poses.points.is_empty() && poses.images.len() == model.images.len());
        for (id, image) in &poses.images {
            assert_eq!(image.name, model.images[id].name);
            let difference = image.cam_from_world * model.images[id].cam_from_world.inverse();
            assert!(difference.translation.vector.norm() < 1e-9, "{difference}");
        }
        files.images.truncate(files.images.len() / 2);
        let cut = read_colmap_poses(&files, is_binary);
        assert!(cut.is_err() || !is_binary);
    }
}

#[test]
fn every_truncation_of_binary_files_is_an_error() {
    let whole = write_colmap_binary(&model());
    for part in 0..3 {
        let length = parts(&mut whole.clone())[part].len();
        for end in 0..length {
            let mut files = whole.clone();
            parts(&mut files)[part].truncate(end);
            assert!(read_colmap_binary(&files).is_err(), "file {part} cut at {end}");
        }
    }
}

/// Text has no length, so a cut file may be a smaller model; it must never panic, nor link to
/// what is not there.
#[test]
fn truncated_text_never_panics() {
    let whole = write_colmap_text(&model());
    for part in 0..3 {
        let length = parts(&mut whole.clone())[part].len();
        for end in 0..length {
            let mut files = whole.clone();
            parts(&mut files)[part].truncate(end);
            if let Ok(read) = read_colmap_text(&files) {
                assert!(read.images.values().all(|i| read.cameras.contains_key(&i.camera)));
            }
        }
    }
}

/// Every byte of the binary form set to 255 in turn: counts, ids, indices, NaN.
#[test]
fn damaged_bytes_never_panic() {
    let whole = write_colmap_binary(&model());
    for part in 0..3 {
        for at in 0..parts(&mut whole.clone())[part].len() {
            for value in [0, 0x7f, 0xff] {
                let mut files = whole.clone();
                parts(&mut files)[part][at] = value;
                if let Ok(read) = read_colmap_binary(&files) {
                    let finite = |p: &Point3d| p.position.iter().all(|v| v.is_finite());
                    assert!(read.points.values().all(finite));
                }
            }
        }
    }
}

#[test]
fn a_promised_terabyte_is_refused() {
    let mut files = write_colmap_binary(&model());
    files.points[..8].copy_from_slice(&(1_u64 << 40).to_le_bytes());
    assert!(matches!(read_colmap_binary(&files), Err(ColmapError::Truncated { .. })));
}

#[test]
fn links_are_checked_both_ways() {
    let mut model = model();
    model.points.get_mut(&PointId(4)).unwrap().track[0].keypoint = 99;
    let error = read_colmap_binary(&write_colmap_binary(&model)).unwrap_err();
    assert_eq!(error, ColmapError::Dangling { file: ColmapFile::Points, what: "image", id: 1 });

    model.points.remove(&PointId(4));
    let error = read_colmap_text(&write_colmap_text(&model)).unwrap_err();
    assert_eq!(error, ColmapError::Dangling { file: ColmapFile::Images, what: "point", id: 5 });
}

#[test]
fn text_refusals_name_the_line() {
    let mut files = write_colmap_text(&model());
    files.cameras = b"# x\n1 PINHOLE 640 480 nan 500 320 240\n".to_vec();
    let error = read_colmap_text(&files).unwrap_err();
    assert!(matches!(error, ColmapError::Invalid { file: ColmapFile::Cameras, record: 2, .. }));
    files.cameras = b"1 FOV 640 480 500 500 320 240 1\n".to_vec();
    assert!(read_colmap_text(&files).unwrap_err().to_string().contains("\"FOV\" is not known"));
}
