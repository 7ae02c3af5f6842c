//! Photos, EXIF and calibrations of real cameras. Skipped, loudly, where the data are absent.

use std::path::{Path, PathBuf};

use volery_formats::{
    DecodeLimits, FocalSource, TelemetrySigmas, decode_image, read_camera_json, read_exif,
    read_ply, read_poses_csv, read_telemetry_csv,
};
use volery_geometry::CameraModel;

fn data() -> Option<PathBuf> {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    if data.is_dir() {
        return Some(data);
    }
    println!("SKIPPED: ../shared/data is absent");
    None
}

fn read(path: PathBuf) -> Vec<u8> {
    std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// P21: the rendered warehouse writes its exact focal length three ways; all agree.
#[test]
fn warehouse_focal_length() {
    let Some(data) = data() else { return };
    let bytes = read(data.join("warehouse_render/scan/scan_0000.jpg"));
    let mut exif = read_exif(&bytes);
    let camera = read_camera_json(&read(data.join("warehouse_render/scan/camera.json"))).unwrap();
    assert_eq!(camera.params()[2..4], [320.0, 240.0]);
    let guess = exif.focal_px(640, 480);
    assert_eq!(guess.source, FocalSource::Exif35mm);
    assert!((guess.px - camera.params()[0]).abs() < 1e-3, "{}", guess.px);
    exif.focal_35mm = None;
    let guess = exif.focal_px(640, 480);
    assert_eq!(guess.source, FocalSource::FocalPlane);
    assert!((guess.px - camera.params()[0]).abs() < 0.5, "{}", guess.px);
    assert!(exif.time_s.is_some() && exif.warnings.is_empty(), "{exif:?}");
}

#[test]
fn kodak_focal_length() {
    let Some(data) = data() else { return };
    let folder = data.join("sceaux_castle/images");
    for entry in std::fs::read_dir(folder).unwrap() {
        let bytes = read(entry.unwrap().path());
        let guess = read_exif(&bytes).focal_px(1600, 1202);
        assert_eq!(guess.source, FocalSource::Exif35mm);
        assert!((guess.px - 35.0 / 36.0 * 1600.0).abs() < 1e-9);
    }
}

/// Calibrations in OpenCV's convention are moved to ours, by 0.5.
#[test]
fn calibrations() {
    let Some(data) = data() else { return };
    let camera = |set: &str| read_camera_json(&read(data.join(set).join("camera.json"))).unwrap();
    let desk = camera("fr2_desk");
    assert_eq!(desk.model, CameraModel::FullOpenCv);
    assert_eq!(desk.params()[2..4], [325.6, 250.2]);
    assert_eq!(camera("redkitchen").model, CameraModel::OpenCv);
    let fountain = camera("fountain_p11");
    assert_eq!(fountain.model, CameraModel::Pinhole);
    assert_eq!(fountain.params()[2], 760.595);
}

#[test]
fn every_photo_decodes_and_no_half_of_one_does() {
    let Some(data) = data() else { return };
    for folder in ["fr2_desk/images", "redkitchen/query", "warehouse_render/query"] {
        for entry in std::fs::read_dir(data.join(folder)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_none_or(|extension| extension != "jpg") {
                continue;
            }
            let bytes = read(path);
            let decoded = decode_image(&bytes, &DecodeLimits::default()).unwrap();
            assert_eq!((decoded.gray.width(), decoded.gray.height()), (640, 480));
            assert!(decoded.color.is_some());
            let half = decode_image(&bytes[..bytes.len() / 2], &DecodeLimits::default());
            assert_eq!(half.unwrap_err().code(), "truncated");
        }
    }
}

#[test]
fn tables_and_clouds() {
    let Some(data) = data() else { return };
    let scan = data.join("warehouse_render/scan");
    let poses = read_poses_csv(&read(scan.join("ground_truth.csv"))).unwrap();
    let sigmas = TelemetrySigmas::default();
    let telemetry = read_telemetry_csv(&read(scan.join("telemetry.csv")), &sigmas).unwrap();
    assert_eq!((poses.len(), telemetry.len()), (110, 110));
    for (pose, row) in poses.iter().zip(&telemetry) {
        assert_eq!(pose.image, row.image);
        let height = row.prior.height.unwrap().height;
        assert!((pose.world_from_cam.translation.z - height).abs() < 0.15);
        // Heading, clockwise from +y, of the camera's forward axis.
        let forward = pose.world_from_cam.rotation * nalgebra::Vector3::z();
        let error = row.prior.attitude.unwrap().yaw - forward.x.atan2(forward.y);
        assert!(error.cos() > 8.0_f64.to_radians().cos(), "{}: {error}", row.image);
    }
    let cloud = read_ply(&read(data.join("redkitchen/ground_truth_cloud.ply"))).unwrap();
    assert_eq!(cloud.points.len(), 132_231);
    assert_eq!(
        read_ply(&read(data.join("warehouse_render/mesh_gt.ply"))).unwrap().points.len(),
        10_077
    );
}
