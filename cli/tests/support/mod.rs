//! Photos of a small synthetic hall, and the `volery` program.
#![allow(dead_code)]

use std::{
    fs,
    path::{Path, PathBuf},
    process::{Command, Output},
};

use image::ImageEncoder;
use serde_json::Value;
use volery_synthetic::DemoHall;

/// A folder that goes when the test ends.
pub(crate) struct Folder(pub(crate) PathBuf);

impl Folder {
    pub(crate) fn new(name: &str) -> Self {
        let path =
            Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    pub(crate) fn join(&self, name: impl AsRef<Path>) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if !std::thread::panicking() {
            let _ = fs::remove_dir_all(&self.0);
        }
    }
}

pub(crate) fn volery(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volery")).args(args).output().unwrap()
}

/// Standard output as JSON, and the exit code.
pub(crate) fn volery_json(args: &[&str]) -> (Value, i32) {
    let output = volery(args);
    let text = String::from_utf8(output.stdout).unwrap();
    let error = String::from_utf8_lossy(&output.stderr);
    let value = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {text:?} {error}"));
    (value, output.status.code().unwrap_or(-1))
}

pub(crate) fn utf8(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// The circle of the demo's scan, half as many photos, as PNG files in `folder/scan` and
/// `folder/query`, with `telemetry.csv` and `truth.csv`.
pub(crate) fn hall_photos(folder: &Path) -> DemoHall {
    let mut hall = DemoHall::new(3);
    hall.scan = hall.scan.into_iter().skip(24).take(18).collect();
    hall.queries.truncate(4);
    take_photos(&hall, folder);
    hall
}

/// All photos of a hall as PNG files in `folder/scan` and `folder/query`, with `telemetry.csv` and
/// `camera.json`.
pub(crate) fn take_photos(hall: &DemoHall, folder: &Path) {
    for (name, shots) in [("scan", &hall.scan), ("query", &hall.queries)] {
        let to = folder.join(name);
        fs::create_dir_all(&to).unwrap();
        for shot in shots {
            let photo = hall.photo(shot);
            let pixels: Vec<u8> = photo.rgb.iter().flatten().copied().collect();
            image::save_buffer(
                to.join(&shot.name),
                &pixels,
                photo.width,
                photo.height,
                image::ColorType::Rgb8,
            )
            .unwrap();
        }
    }
    let rows = hall.scan.iter().map(|shot| (shot.name.as_str(), &shot.prior));
    fs::write(folder.join("telemetry.csv"), volery_synthetic::telemetry_csv(rows)).unwrap();
    let camera = volery_formats::write_camera_json(hall.camera());
    fs::write(folder.join("camera.json"), camera).unwrap();
}

/// Root mean square of the position errors of a `poses.csv` after the best similarity, meters.
pub(crate) fn position_error(hall: &DemoHall, poses_csv: &Path) -> (usize, f64) {
    let poses = volery_formats::read_poses_csv(&fs::read(poses_csv).unwrap()).unwrap();
    let center = |pose: &volery_geometry::Isometry3<f64>| {
        volery_geometry::Point3::from(pose.translation.vector)
    };
    let truth = |name: &str| {
        let mut shots = hall.scan.iter().chain(&hall.queries);
        let shot = shots.find(|shot| shot.name == name).unwrap();
        center(&shot.cam_from_world.inverse())
    };
    let source: Vec<_> = poses.iter().map(|pose| center(&pose.world_from_cam)).collect();
    let target: Vec<_> = poses.iter().map(|pose| truth(&pose.image)).collect();
    let fit = volery_geometry::similarity_from_points(&source, &target).unwrap();
    let squares: f64 = source.iter().zip(&target).map(|(s, t)| (fit * s - t).norm_squared()).sum();
    (poses.len(), (squares / poses.len() as f64).sqrt())
}

/// All files of a map folder that must be equal for equal runs, by name.
pub(crate) fn map_bytes(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            if name == ".work" || name.starts_with("report.") {
                continue;
            }
            if path.is_dir() {
                folders.push(path);
            } else {
                let bytes = fs::read(&path).unwrap();
                files.push((path.strip_prefix(folder).unwrap().to_owned(), bytes));
            }
        }
    }
    files.sort();
    files
}

/// A small photo of nothing, another one for every seed.
pub(crate) fn noise_png(seed: u32) -> Vec<u8> {
    let mut state = seed;
    let pixels: Vec<u8> = (0..160 * 120)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        })
        .collect();
    png(&pixels, 160, 120)
}

/// Gray pixels as a file.
pub(crate) fn png(pixels: &[u8], width: u32, height: u32) -> Vec<u8> {
    let mut bytes = Vec::new();
    image::codecs::png::PngEncoder::new(&mut bytes)
        .write_image(pixels, width, height, image::ExtendedColorType::L8)
        .unwrap();
    bytes
}
