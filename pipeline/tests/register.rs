//! Maps of two flights through one hall become one map.

use std::{
    fs,
    path::{Path, PathBuf},
};

use volery_geometry::{Camera, CameraModel, Point3, Vector3, similarity_from_points};
use volery_pipeline::{
    CameraSpec, ImageInput, JobSpec, MapFolder, MapSource, Preset, RegisterReport, StageGroup,
    map_folder::read_map, reconstruct, register_maps,
};
use volery_scene::{NoProgress, RegisteredImage};
use volery_synthetic::{CenterMotion, Hall, Renderer, Sensor, yaw_scan};

/// Photos of the whole round, and those of the two flights; they share the view of five photos,
/// not the photos.
const NUM_PHOTOS: usize = 28;
const FLIGHTS: [std::ops::Range<usize>; 2] = [0..16, 12..28];

struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR"))
            .join(format!("register-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

fn camera() -> Camera {
    Camera::from_focal(CameraModel::Pinhole, 400, 300, 300.0).unwrap()
}

fn round(seed: u64) -> Vec<volery_geometry::Isometry3<f64>> {
    let motion = CenterMotion::Circle { radius: 0.9 };
    yaw_scan(&Point3::new(0.0, 0.0, 1.5), NUM_PHOTOS, 0.2, motion, seed)
}

/// The map of a flight; photos are named by their place on the round, as in every flight.
fn fly(folder: &Path, hall_seed: u64, flight: usize) -> MapSource {
    let hall = Hall::furnished(Vector3::new(8.0, 7.0, 3.0), 0.008, hall_seed);
    let renderer = Renderer::new(&camera());
    let poses = round(5 + flight as u64);
    let images = FLIGHTS[flight].clone().map(|i| {
        let seed = (100 * flight + i) as u64;
        let photo = Sensor::default().expose(&renderer.render(&hall, &poses[i]), seed);
        let pixels: Vec<u8> = photo.rgb.iter().flatten().copied().collect();
        let path = folder.join(format!("{hall_seed}-{flight}-{i}.png"));
        image::save_buffer(&path, &pixels, photo.width, photo.height, image::ColorType::Rgb8)
            .unwrap();
        ImageInput::new(format!("{i}.png"), path)
    });
    let spec = JobSpec {
        camera: Some(CameraSpec::from(&camera())),
        stages: vec![StageGroup::Sfm],
        preset: Preset::Fast,
        ..JobSpec::new(images.collect())
    };
    let name = format!("flight {hall_seed}-{flight}");
    let out = folder.join(&name);
    let summary = reconstruct(&spec, &folder.join("work"), &out, &NoProgress).unwrap();
    assert_eq!(summary.num_registered, FLIGHTS[flight].len(), "{:?}", summary.quality);
    MapSource { name, folder: out }
}

/// P52, P53: one frame, one model, one index; photos of either flight are where they were taken.
#[test]
fn two_flights_become_one_map() {
    let folder = Folder::new("join");
    let sources = [fly(&folder.0, 5, 0), fly(&folder.0, 5, 1)];
    let out = folder.0.join("joined");
    let report = register_maps(&sources, 1, &out, &NoProgress).unwrap();
    assert_eq!(report.lack(), None);
    let [pair] = &report.pairs[..] else { panic!("{:?}", report.pairs) };
    assert!(pair.used && pair.num_inliers >= 20 && pair.error.is_none(), "{pair:?}");
    assert!(pair.overlap > 0.1 && report.num_shared_points >= 20);
    assert!(report.reprojection_px.unwrap() < 1.5);

    let (info, map) = read_map(&out).unwrap();
    assert_eq!((info.num_images, info.inputs.len()), (32, 32));
    let truth: Vec<Point3<f64>> = FLIGHTS
        .iter()
        .enumerate()
        .flat_map(|(flight, range)| range.clone().map(move |i| (flight, i)))
        .map(|(flight, i)| Point3::from(round(5 + flight as u64)[i].inverse().translation.vector))
        .collect();
    let found: Vec<Point3<f64>> = map.model.images.values().map(RegisteredImage::center).collect();
    let align = similarity_from_points(&found, &truth).unwrap();
    for (image, (found, truth)) in map.model.images.values().zip(found.iter().zip(&truth)) {
        let off = (align * found - truth).norm();
        assert!(off < 0.03, "{} is off by {off} m", image.name);
    }
    // The second flight repeats names of the first.
    let names: Vec<&str> = map.model.images.values().map(|image| image.name.as_str()).collect();
    assert_eq!((names[15], names[16], names[31]), ("15.png", "2/12.png", "27.png"));
    let index = MapFolder::open(&out).unwrap();
    assert_eq!(index.index().num_images(), 32);
    let alone = MapFolder::open(&sources[0].folder).unwrap();
    assert!(index.index().num_points() > alone.index().num_points() * 3 / 2);

    // A map that was joined can be joined again, and equal runs give equal bytes.
    let again = folder.0.join("again");
    assert_eq!(register_maps(&sources, 1, &again, &NoProgress).unwrap(), report);
    for name in ["map.json", "localization.bin", "colmap/points3D.txt"] {
        assert!(fs::read(out.join(name)).unwrap() == fs::read(again.join(name)).unwrap(), "{name}");
    }
    let kept: RegisterReport =
        serde_json::from_slice(&fs::read(out.join("report.json")).unwrap()).unwrap();
    assert_eq!(kept, report);
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(sources.iter().all(|source| page.contains(&source.name)));
}

/// Two halls are not one, and one map is nothing to join; nothing is written.
#[test]
fn flights_through_two_halls_are_refused() {
    let folder = Folder::new("refuse");
    let sources = [fly(&folder.0, 5, 0), fly(&folder.0, 6, 1)];
    let out = folder.0.join("joined");
    let error = register_maps(&sources, 1, &out, &NoProgress).unwrap_err();
    assert_eq!(error.code, "no_overlap", "{error}");
    assert!(!out.join("map.json").exists());
    let error = register_maps(&sources[..1], 1, &out, &NoProgress).unwrap_err();
    assert_eq!(error.code, "bad_input");
    let missing = MapSource { name: "x".to_owned(), folder: folder.0.join("x") };
    let error = register_maps(&[sources[0].clone(), missing], 1, &out, &NoProgress).unwrap_err();
    assert_eq!(error.code, "bad_map");
}
