//! Maps at the poses of another program.

mod support;

use std::{collections::BTreeSet, fs, path::Path};

use support::{Folder, Scan};
use volery_formats::{colmap::write_colmap_text, read_poses_csv};
use volery_geometry::{Isometry3, Vector3};
use volery_localization::{LocalizationPrior, LocalizeOptions, Status};
use volery_pipeline::{
    JobSpec, MapFolder, PoseSource, Summary, error::code, read_foreign_model, reconstruct,
};
use volery_scene::{
    CameraId, GrayImage, ImageId, NoProgress, RegisteredImage, SparseModel, UnplacedReason,
};

const NUM_PHOTOS: usize = 10;
/// Not in the model that is given; asked for its pose.
const QUERY: usize = 4;

/// COLMAP's files of the photos with their true poses in a world moved by `world_from_true`, but for
/// the query; in folders, as PNG instead of JPEG, as other programs have it.
fn colmap_files(scan: &Scan, world_from_true: &Isometry3<f64>) -> [(String, Vec<u8>); 2] {
    let mut model = SparseModel::default();
    model.cameras.insert(CameraId(0), scan.camera);
    for (i, cam_from_true) in scan.poses.iter().enumerate().filter(|(i, _)| *i != QUERY) {
        let image = RegisteredImage {
            name: format!("images/{i}.png"),
            camera: CameraId(0),
            cam_from_world: cam_from_true * world_from_true.inverse(),
            keypoints: Vec::new(),
            points: Vec::new(),
        };
        model.images.insert(ImageId(i as u32), image);
    }
    let files = write_colmap_text(&model);
    [("cameras.txt".to_owned(), files.cameras), ("images.txt".to_owned(), files.images)]
}

/// The scan with the poses and cameras of the files, and without any calibration of its own.
fn with_model(scan: &Scan, files: &[(String, Vec<u8>)], poses: PoseSource) -> JobSpec {
    let files: Vec<(String, &[u8])> =
        files.iter().map(|(name, bytes)| (name.clone(), bytes.as_slice())).collect();
    let names: BTreeSet<String> = scan.spec.images.iter().map(|i| i.name.clone()).collect();
    let mut model = read_foreign_model(&files, &names).unwrap();
    assert_eq!((model.images.len(), &model.unknown[..]), (NUM_PHOTOS - 1, &[][..]));
    let mut spec = JobSpec { camera: None, poses, ..scan.spec.clone() };
    for image in &mut spec.images {
        (image.prior.pose, image.camera) = model.images.remove(&image.name).unzip();
    }
    spec
}

fn run(spec: &JobSpec, folder: &Path) -> Summary {
    reconstruct(spec, &folder.join("work"), &folder.join("out"), &NoProgress).unwrap()
}

/// In meters with z up the map keeps the frame: its poses are those of the model, and a photo that
/// was not in the model finds its true pose.
#[test]
fn the_frame_of_a_metric_model_is_kept() {
    let folder = Folder::new("given-metric");
    let scan = Scan::new(&folder.0, NUM_PHOTOS);
    let moved = Isometry3::new(Vector3::new(20.0, -3.0, 0.5), Vector3::new(0.0, 0.0, 0.7));
    let spec = with_model(&scan, &colmap_files(&scan, &moved), PoseSource::GivenMetric);
    let summary = run(&spec, &folder.0);
    assert_eq!(summary.num_registered, NUM_PHOTOS - 1, "{:?}", summary.quality);
    let query = summary.images.iter().find(|image| image.name == format!("{QUERY}.png")).unwrap();
    assert_eq!(query.reason, Some(UnplacedReason::NoGivenPose));
    assert!(summary.scale.metric);

    let out = folder.0.join("out");
    let poses = read_poses_csv(&fs::read(out.join("poses.csv")).unwrap()).unwrap();
    for pose in &poses {
        let index: usize = pose.image.trim_end_matches(".png").parse().unwrap();
        let truth = moved * scan.poses[index].inverse();
        let difference = truth.inverse() * pose.world_from_cam;
        assert!(difference.translation.vector.norm() < 1e-6, "{index}: {difference}");
        assert!(difference.rotation.angle() < 1e-6, "{index}: {difference}");
    }

    let map = MapFolder::open(&out).unwrap();
    let photo = image::open(&spec.images[QUERY].path).unwrap().to_luma8();
    let (width, height) = photo.dimensions();
    let photo = GrayImage::new(width, height, photo.into_raw()).unwrap();
    let (prior, options) = (LocalizationPrior::default(), LocalizeOptions::default());
    let (answer, _) = map.localize(&photo, &scan.camera, &prior, &options);
    let Status::Ok(found) = &answer.status else { panic!("{:?}", answer.status) };
    let truth = moved * scan.poses[QUERY].inverse();
    let difference = truth.inverse() * found.map_from_camera;
    assert!(difference.translation.vector.norm() < 0.01, "{difference}");
    assert!(difference.rotation.angle().to_degrees() < 0.2, "{difference}");
}

/// Without such a promise the map is like any other: level as far as can be told, not metric.
#[test]
fn a_model_of_any_frame_is_aligned_like_any_map() {
    let folder = Folder::new("given");
    let scan = Scan::new(&folder.0, NUM_PHOTOS);
    let moved = Isometry3::new(Vector3::new(5.0, 1.0, 2.0), Vector3::new(1.2, -0.4, 0.7));
    let mut spec = with_model(&scan, &colmap_files(&scan, &moved), PoseSource::Given);
    let summary = run(&spec, &folder.0);
    assert_eq!(summary.num_registered, NUM_PHOTOS - 1);
    assert!(!summary.scale.metric && summary.warnings.iter().any(|w| w.code == "not_metric"));

    for image in &mut spec.images {
        image.prior.pose = None;
    }
    let (work, out) = (folder.0.join("work"), folder.0.join("none"));
    let error = reconstruct(&spec, &work, &out, &NoProgress).unwrap_err();
    assert_eq!(error.code, code::NO_GIVEN_POSES);
}
