//! A few rendered photos, and work that is stopped.
#![allow(dead_code, reason = "every test uses its part")]

use std::{
    fs,
    path::{Path, PathBuf},
    sync::atomic::{AtomicBool, Ordering},
};

use volery_geometry::{Camera, CameraModel, Isometry3, Point3, Vector3};
use volery_pipeline::{CameraSpec, ImageInput, JobSpec, StageGroup, StageProgress};
use volery_scene::{Progress, Stage};
use volery_synthetic::{CenterMotion, Hall, Renderer, Sensor, yaw_scan};

/// Removed with its handle.
pub(crate) struct Folder(pub(crate) PathBuf);

impl Folder {
    pub(crate) fn new(name: &str) -> Self {
        let path = Path::new(env!("CARGO_TARGET_TMPDIR"))
            .join(format!("pipeline-{name}-{}", std::process::id()));
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

/// Photos of a hall, with all that is true of them.
pub(crate) struct Scan {
    pub(crate) hall: Hall,
    pub(crate) camera: Camera,
    pub(crate) poses: Vec<Isometry3<f64>>,
    /// To the sparse map.
    pub(crate) spec: JobSpec,
}

impl Scan {
    /// Part of a circle of 0.9 m radius, camera looking outward; the files go to `folder`.
    pub(crate) fn new(folder: &Path, num_photos: usize) -> Self {
        Self::of_hall(Vector3::new(8.0, 7.0, 3.0), 5, folder, num_photos)
    }

    /// Of a hall of another size, with other things in it.
    pub(crate) fn of_hall(size: Vector3<f64>, seed: u64, folder: &Path, num_photos: usize) -> Self {
        let camera = Camera::from_focal(CameraModel::Pinhole, 400, 300, 300.0).unwrap();
        let hall = Hall::furnished(size, 0.008, seed);
        let renderer = Renderer::new(&camera);
        let motion = CenterMotion::Circle { radius: 0.9 };
        let poses = yaw_scan(&Point3::new(0.0, 0.0, 1.5), num_photos, 0.22, motion, 5);
        let images = poses.iter().enumerate().map(|(i, pose)| {
            let photo = Sensor::default().expose(&renderer.render(&hall, pose), i as u64);
            let pixels: Vec<u8> = photo.rgb.iter().flatten().copied().collect();
            let path = folder.join(format!("{i}.png"));
            let (width, height) = (photo.width, photo.height);
            image::save_buffer(&path, &pixels, width, height, image::ColorType::Rgb8).unwrap();
            ImageInput::new(format!("{i}.png"), path)
        });
        let spec = JobSpec {
            camera: Some(CameraSpec::from(&camera)),
            stages: vec![StageGroup::Sfm],
            ..JobSpec::new(images.collect())
        };
        Self { hall, camera, poses, spec }
    }
}

/// Stops the work once `stage` has finished a unit.
pub(crate) struct StopIn {
    stage: Stage,
    stopped: AtomicBool,
}

impl Progress for StopIn {
    fn report(&self, stage: Stage, done: usize, _total: usize) {
        if stage == self.stage && done > 0 {
            self.stopped.store(true, Ordering::Relaxed);
        }
    }

    fn is_cancelled(&self) -> bool {
        self.stopped.load(Ordering::Relaxed)
    }
}

impl StageProgress for StopIn {}

impl StopIn {
    pub(crate) fn new(stage: Stage) -> Self {
        Self { stage, stopped: AtomicBool::new(false) }
    }
}
