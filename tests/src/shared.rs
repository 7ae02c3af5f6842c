//! Real photos with ground truth, beside the repository.

use std::path::{Path, PathBuf};

use volery_formats::{read_camera_json, read_poses_csv};
use volery_geometry::Camera;

use crate::evaluation::Poses;
use crate::repository_root;

/// A folder of the shared data, or `None`, said aloud, where it is absent.
pub fn shared_data(name: &str) -> Option<PathBuf> {
    let root = repository_root();
    let path = root.parent()?.join("shared").join("data").join(name);
    if path.is_dir() {
        return Some(path);
    }
    eprintln!("SKIPPED: ../shared/data/{name} is absent");
    None
}

/// Photos of one camera with what is known of them.
#[derive(Debug, Clone)]
pub struct SharedSet {
    /// Name of the folder.
    pub name: String,
    /// Where the photos lie.
    pub images_dir: PathBuf,
    /// Names of the photos, sorted.
    pub images: Vec<String>,
    /// Calibration, where published.
    pub camera: Option<Camera>,
    /// True poses; empty where unknown.
    pub truth: Poses,
    /// The folder with the other files of the set.
    pub dir: PathBuf,
}

impl SharedSet {
    /// A set by its folder (`warehouse_render/scan` has its photos beside its tables).
    ///
    /// # Panics
    ///
    /// If a file of a set that is there cannot be read: the set is damaged.
    pub fn open(name: &str) -> Option<Self> {
        let dir = shared_data(name)?;
        let inner = dir.join("images");
        let images_dir = if inner.is_dir() { inner } else { dir.clone() };
        let read = |file: &str| std::fs::read(dir.join(file)).ok();
        let camera = read("camera.json")
            .map(|bytes| read_camera_json(&bytes).expect("camera.json of a shared set is valid"));
        let truth = read_poses(&dir.join("ground_truth.csv")).unwrap_or_default();
        let mut images: Vec<String> = std::fs::read_dir(&images_dir)
            .expect("the folder of a shared set is readable")
            .flatten()
            .filter_map(|entry| entry.file_name().into_string().ok())
            .filter(|name| {
                let name = name.to_ascii_lowercase();
                [".jpg", ".jpeg", ".png"].iter().any(|end| name.ends_with(end))
            })
            .collect();
        images.sort();
        Some(Self { name: name.to_owned(), images_dir, images, camera, truth, dir })
    }
}

/// The poses of a table; `None` if it is absent or damaged.
pub fn read_poses(path: &Path) -> Option<Poses> {
    let poses = read_poses_csv(&std::fs::read(path).ok()?).ok()?;
    Some(poses.into_iter().map(|pose| (pose.image, pose.world_from_cam)).collect())
}
