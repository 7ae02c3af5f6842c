use std::{fs, path::PathBuf};

use nalgebra::{Isometry3, UnitQuaternion};
use volery_api::{ControlObservation, KnownDistance};
use volery_geometry::{Camera, CameraModel};
use volery_scene::{CameraId, ImageId, Point3d, PointId, Quality, Verdict};

use super::*;
use crate::map_folder::MAP_FORMAT;

/// A map of six cameras around a box of points, in a folder that is deleted at the end.
struct Hall {
    folder: PathBuf,
    map: EnvironmentMap,
}

impl Hall {
    fn new(name: &str) -> Self {
        let mut model = SparseModel::default();
        let camera = Camera::new(CameraModel::Pinhole, 640, 480, &[500.0, 500.0, 320.0, 240.0]);
        model.cameras.insert(CameraId(0), camera.unwrap());
        for i in 0..8_u64 {
            let corner = |bit: u64| f64::from(u8::from(i >> bit & 1 == 1)) - 0.5;
            let position = Point3::new(corner(0), corner(1), 0.7 * corner(2) + 1.0);
            let (color, track) = ([9; 3], Vec::new());
            model.points.insert(PointId(i), Point3d { position, color, error_px: 0.1, track });
        }
        for i in 0..6 {
            let angle = f64::from(i);
            let center = Point3::new(3.0 * angle.cos(), 3.0 * angle.sin(), 1.0 + 0.1 * angle);
            let ahead = Point3::new(0.0, 0.0, 1.0) - center;
            let rotation = UnitQuaternion::face_towards(&ahead, &-Vector3::z());
            let cam_from_world = Isometry3::from_parts(center.into(), rotation).inverse();
            let camera = &model.cameras[&CameraId(0)];
            let see = |point: &Point3d| camera.project(&(cam_from_world * point.position));
            let keypoints: Vec<_> = model.points.values().map(|p| see(p).unwrap()).collect();
            model.add_image(RegisteredImage {
                name: format!("{i}.jpg"),
                camera: CameraId(0),
                cam_from_world,
                keypoints,
                points: (0..8).map(|i| Some(PointId(i))).collect(),
            });
        }
        let scale = Scale { metric: true, source: ScaleSource::Heights, sigma_rel: Some(0.02) };
        let gravity = Gravity { source: GravitySource::Attitude, sigma: Some(0.01) };
        let quality = Quality { verdict: Verdict::Good, reasons: Vec::new() };
        let origin = OriginRule::LastCamera;
        let info = MapInfo {
            format: MAP_FORMAT,
            software: "volery".to_owned(),
            scale,
            gravity,
            origin,
            quality,
            cameras: model.cameras.values().map(Into::into).collect(),
            num_images: 6,
            num_points: 8,
            num_dense_points: None,
            free_space_voxel: None,
            num_triangles: None,
            bounds: bounds(&model),
            north: None,
            map_from_index: None,
            seed: 0,
            inputs: Vec::new(),
        };
        let map = info.map(model);
        let folder =
            std::env::temp_dir().join(format!("volery-align-{}-{name}", std::process::id()));
        let before = folder.join("before");
        fs::create_dir_all(&before).unwrap();
        fs::create_dir_all(folder.join("after")).unwrap();
        write_files(&map, &info, b"index", &before, &NoProgress).unwrap();
        let report = json!({ "scale": scale, "images": [{"name": "lost.jpg"}], "num_zones": 0 });
        fs::write(before.join(file::REPORT), report.to_string()).unwrap();
        Self { folder, map }
    }

    /// The map after it, with its facts.
    fn aligned(&self, align: &AlignRequest) -> (MapInfo, EnvironmentMap) {
        let after = self.folder.join("after");
        align_folder(&self.folder.join("before"), &after, align).unwrap();
        let (info, map) = read_map(&after).unwrap();
        assert_eq!(fs::read(after.join(file::LOCALIZATION)).unwrap(), b"index");
        let report = fs::read(after.join(file::REPORT)).unwrap();
        let report: Value = serde_json::from_slice(&report).unwrap();
        assert_eq!(report["scale"], serde_json::to_value(info.scale).unwrap());
        assert_eq!(report["images"][0]["name"], "lost.jpg");
        (info, map)
    }

    fn code(&self, align: &AlignRequest) -> String {
        let folders = [self.folder.join("before"), self.folder.join("after")];
        align_folder(&folders[0], &folders[1], align).unwrap_err().code
    }
}

impl Drop for Hall {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.folder);
    }
}

fn distance(map: &EnvironmentMap, a: &str, b: &str) -> f64 {
    (center(&map.model, a).unwrap() - center(&map.model, b).unwrap()).norm()
}

/// Every camera still sees every point where it saw it, whatever the frame.
fn assert_sees_the_same(map: &EnvironmentMap, before: &EnvironmentMap) {
    for (id, image) in &map.model.images {
        let camera = &map.model.cameras[&image.camera];
        for (point, seen) in map.model.points.values().zip(&before.model.images[id].keypoints) {
            let pixel = camera.project(&(image.cam_from_world * point.position)).unwrap();
            assert!((pixel - seen).norm() < 1e-6, "{id:?} sees it at {pixel}, not at {seen}");
        }
    }
}

fn sim3(rotation: UnitQuaternion<f64>, translation: [f64; 3], scale: f64) -> Sim3 {
    let rotation = [rotation.w, rotation.i, rotation.j, rotation.k];
    Sim3 { rotation, translation, scale, metric: true, sigma_rel: None }
}

#[test]
fn a_known_distance_is_the_scale() {
    let hall = Hall::new("distance");
    let [image_a, image_b] = ["0.jpg", "3.jpg"].map(str::to_owned);
    let known = KnownDistance { image_a, image_b, meters: 4.0 };
    let (info, map) = hall.aligned(&AlignRequest::KnownDistance(known.clone()));
    assert!((distance(&map, "0.jpg", "3.jpg") - 4.0).abs() < 1e-9);
    assert_sees_the_same(&map, &hall.map);
    let sigma_rel = Some(DISTANCE_SIGMA / 4.0);
    let source = ScaleSource::KnownDistance;
    assert_eq!(info.scale, Scale { metric: true, source, sigma_rel });
    assert_eq!((info.gravity, info.origin), (hall.map.gravity, hall.map.origin));
    // What the index finds is moved as the map was.
    let moved = info.map_from_index.unwrap().similarity();
    let before = center(&hall.map.model, "2.jpg").unwrap();
    assert!((moved * before - center(&map.model, "2.jpg").unwrap()).norm() < 1e-9);
    let nobody = KnownDistance { image_b: "x.jpg".to_owned(), ..known.clone() };
    assert_eq!(hall.code(&AlignRequest::KnownDistance(nobody)), "unknown_image");
    let itself = KnownDistance { image_b: "0.jpg".to_owned(), ..known };
    assert_eq!(hall.code(&AlignRequest::KnownDistance(itself)), "degenerate");
}

/// A proof stays with what it proves, and no longer.
#[test]
fn what_is_set_by_hand_keeps_no_proof_of_something_else() {
    let hall = Hall::new("sim3");
    let level = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 1.0);
    let (info, map) = hall.aligned(&AlignRequest::Sim3(sim3(level, [0.0; 3], 1.0)));
    assert_sees_the_same(&map, &hall.map);
    assert_eq!(
        (info.scale, info.gravity, info.origin),
        (hall.map.scale, hall.map.gravity, hall.map.origin)
    );

    let (info, _) = hall.aligned(&AlignRequest::Sim3(sim3(level, [1.0, 0.0, 0.0], 1.0)));
    assert_eq!((info.scale, info.gravity), (hall.map.scale, hall.map.gravity));
    assert_eq!(info.origin, OriginRule::Given);

    let tilted = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 0.1);
    let (info, map) = hall.aligned(&AlignRequest::Sim3(sim3(tilted, [0.0; 3], 1.0)));
    assert_sees_the_same(&map, &hall.map);
    assert_eq!(info.gravity, Gravity { source: GravitySource::Given, sigma: None });
    assert_eq!((info.scale, info.origin), (hall.map.scale, hall.map.origin));

    let resized = sim3(UnitQuaternion::identity(), [0.0; 3], 1.1);
    let (info, map) = hall.aligned(&AlignRequest::Sim3(resized.clone()));
    assert!(
        (distance(&map, "0.jpg", "3.jpg") / distance(&hall.map, "0.jpg", "3.jpg") - 1.1).abs()
            < 1e-9
    );
    let given = Scale { metric: true, source: ScaleSource::Given, sigma_rel: None };
    assert_eq!((info.scale, info.gravity), (given, hall.map.gravity));

    let measured = Sim3 { sigma_rel: Some(0.003), ..resized.clone() };
    let (info, _) = hall.aligned(&AlignRequest::Sim3(measured));
    assert_eq!(info.scale, Scale { sigma_rel: Some(0.003), ..given });

    let (info, _) = hall.aligned(&AlignRequest::Sim3(Sim3 { metric: false, ..resized }));
    let unknown = Scale { metric: false, source: ScaleSource::Unknown, sigma_rel: None };
    assert_eq!(info.scale, unknown);
}

#[test]
fn surveyed_points_give_the_whole_frame() {
    let hall = Hall::new("points");
    let pose = Isometry3::new(Vector3::new(5.0, -2.0, 0.3), Vector3::new(0.2, -0.1, 2.0));
    let truth = Similarity3::from_isometry(pose, 1.7);
    let point = |i: u64| {
        let seen = |image: u32| ControlObservation {
            image: format!("{image}.jpg"),
            pixel: hall.map.model.images[&ImageId(image)].keypoints[i as usize].into(),
        };
        let position = truth * hall.map.model.points[&PointId(i)].position;
        ControlPoint { position: position.into(), observations: vec![seen(0), seen(2), seen(4)] }
    };
    let points: Vec<_> = [0, 3, 5, 6].map(point).into();
    let (info, map) = hall.aligned(&AlignRequest::ControlPoints(points.clone()));
    assert_sees_the_same(&map, &hall.map);
    for (after, before) in map.model.points.values().zip(hall.map.model.points.values()) {
        assert!((after.position - truth * before.position).norm() < 1e-6);
    }
    assert_eq!(info.scale.source, ScaleSource::ControlPoints);
    assert_eq!(info.gravity.source, GravitySource::ControlPoints);
    assert_eq!((info.scale.metric, info.origin), (true, OriginRule::Given));

    let mut once = points.clone();
    once[1].observations.truncate(1);
    assert_eq!(hall.code(&AlignRequest::ControlPoints(once)), "degenerate");
    assert_eq!(hall.code(&AlignRequest::ControlPoints(points[..2].to_vec())), "degenerate");
}
