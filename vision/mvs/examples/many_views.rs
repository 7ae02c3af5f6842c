//! Memory of a dense reconstruction of many views: `many_views NUM FOLDER [CLUSTER]`.
//!
//! Rings of drones look outward in a rendered hall, photos of 1.23 megapixels each, rendered when
//! they are asked for; the options are those of the preset `balanced`. Finished units go to files
//! in `FOLDER`. Prints the peak of memory and the time of the processor after each stage.

use std::fs;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

use volery_geometry::{Camera, CameraModel, Isometry3, Point3, Vector3};
use volery_mvs::{DenseOptions, Item, NotKept, Shelf, reconstruct_dense};
use volery_scene::{ImageId, Photo, Photos, Progress, Stage};
use volery_synthetic::{CenterMotion, Hall, Renderer, Sensor, yaw_scan};

#[path = "../tests/support/mod.rs"]
#[allow(dead_code, reason = "a part of what the tests need")]
mod support;

/// Views of a ring.
const RING: usize = 50;
/// Points of the sparse model per view.
const POINTS_PER_VIEW: usize = 20;
/// Depth maps in memory at once, as `balanced` has it.
const CLUSTER: usize = 50;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let usage = "usage: many_views NUM FOLDER [CLUSTER]";
    let mut arguments = std::env::args().skip(1);
    let num: usize = arguments.next().ok_or(usage)?.parse()?;
    let folder = PathBuf::from(arguments.next().ok_or(usage)?);
    let cluster_size = arguments.next().map_or(Ok(CLUSTER), |v| v.parse())?;
    fs::create_dir_all(&folder)?;

    let camera = Camera::from_focal(CameraModel::Pinhole, 1280, 960, 900.0)?;
    let hall = Hall::furnished(Vector3::new(12.0, 10.0, 4.0), 0.005, 7);
    let poses = rings(num);
    let model = support::sparse_model(&hall.room, &camera, &poses, POINTS_PER_VIEW * num);
    let drone = Drone { renderer: Renderer::new(&camera), hall, poses };
    println!("{num} views, {cluster_size} at once: {} MiB before", peak_mib());
    let shelf = Files { folder, num_bytes: AtomicU64::new(0) };
    let options =
        DenseOptions { cluster_size, cell_px: 2.0, max_pixels: 320_000, ..DenseOptions::default() };
    let dense = reconstruct_dense(&model, &drone, &shelf, &options, &Steps)?;
    println!(
        "{} depth maps of {:.1} MP, {} points, {} MiB of units: peak of {} MiB, {:.0} CPU s",
        dense.images.len(),
        dense.num_pixels[0] as f64 * 1e-6,
        dense.cloud.points.len(),
        shelf.num_bytes.load(Ordering::Relaxed) >> 20,
        peak_mib(),
        cpu_s()
    );
    Ok(())
}

/// Rings of different heights and radii around the middle of the hall.
fn rings(num: usize) -> Vec<Isometry3<f64>> {
    let ring = |number: usize| {
        let radius = 1.0 + 0.15 * (number % 4) as f64;
        let center = Point3::new(0.0, 0.0, 0.9 + 0.2 * number as f64);
        let step = std::f64::consts::TAU / RING as f64;
        yaw_scan(&center, RING, step, CenterMotion::Circle { radius }, number as u64)
    };
    (0..num.div_ceil(RING)).flat_map(ring).take(num).collect()
}

struct Drone {
    hall: Hall,
    renderer: Renderer,
    poses: Vec<Isometry3<f64>>,
}

impl Photos for Drone {
    fn photo(&self, image: ImageId) -> Option<Photo> {
        let rendering = self.renderer.render(&self.hall, self.poses.get(image.0 as usize)?);
        let photo = Sensor::default().expose(&rendering, u64::from(image.0));
        Some(Photo { gray: photo.gray(), colors: Some(photo.rgb) })
    }
}

/// A shelf on disk.
struct Files {
    folder: PathBuf,
    /// That were put there.
    num_bytes: AtomicU64,
}

impl Files {
    fn path(&self, image: ImageId, item: Item) -> PathBuf {
        self.folder.join(format!("{}-{item:?}", image.0))
    }
}

impl Shelf for Files {
    fn has(&self, image: ImageId, item: Item) -> bool {
        self.path(image, item).exists()
    }

    fn get(&self, image: ImageId, item: Item) -> Option<Vec<u8>> {
        fs::read(self.path(image, item)).ok()
    }

    fn put(&self, image: ImageId, item: Item, bytes: Vec<u8>) -> Result<(), NotKept> {
        self.num_bytes.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        fs::write(self.path(image, item), bytes).map_err(|_| NotKept)
    }

    fn forget(&self, image: ImageId, item: Item) {
        // It may not be there.
        let _ = fs::remove_file(self.path(image, item));
    }
}

struct Steps;

impl Progress for Steps {
    fn report(&self, stage: Stage, done: usize, total: usize) {
        if done.is_multiple_of(50) {
            println!("{stage:?} {done} of {total}: {} MiB, {:.0} CPU s", peak_mib(), cpu_s());
        }
    }
}

/// Most memory that this process ever had (Linux).
fn peak_mib() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok()).unwrap_or(0) >> 10
}

/// Seconds of CPU of this process so far, all threads (Linux).
fn cpu_s() -> f64 {
    let stat = fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or("").split_whitespace().collect();
    let ticks = |i: usize| fields.get(i).and_then(|f| f.parse::<f64>().ok()).unwrap_or(0.0);
    (ticks(11) + ticks(12)) / 100.0
}
