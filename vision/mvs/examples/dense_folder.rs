//! Dense reconstruction of a folder: `dense_folder PHOTOS MODEL OUT [options]`.
//!
//! `MODEL` holds `cameras.txt`, `images.txt` and `points3D.txt` of COLMAP. Writes
//! `OUT/dense.ply` and `OUT/NAME.depth`: u32 width and height, then for all pixels f32 depth, u8
//! confidence, u8 whether inferred, little endian.
//!
//! * `--pixels N`: pixels of a depth map.
//! * `--sources N`: other images per image.
//! * `--cluster N`: images that are in memory at once.
//! * `--cell PX`: one point per cell of so many pixels.

use std::path::{Path, PathBuf};
use std::sync::Mutex;

use volery_formats::colmap::read_colmap_text;
use volery_formats::{ColmapFiles, DecodeLimits, decode_image, write_ply_of_cloud};
use volery_mvs::{DenseOptions, MemoryShelf, depth_map, reconstruct_dense};
use volery_scene::{DepthMap, ImageId, Photo, Photos, Progress, SparseModel, Stage};

type Failure = Box<dyn std::error::Error>;

struct Folder<'a> {
    path: &'a Path,
    model: &'a SparseModel,
}

impl Photos for Folder<'_> {
    fn photo(&self, image: ImageId) -> Option<Photo> {
        let bytes = std::fs::read(self.path.join(&self.model.images.get(&image)?.name)).ok()?;
        let decoded = decode_image(&bytes, &DecodeLimits::default()).ok()?;
        let rgb = decoded.color.as_ref().map(|color| color.to_rgb());
        let colors = rgb.map(|rgb| rgb.as_chunks::<3>().0.to_vec());
        Some(Photo { gray: decoded.gray, colors })
    }
}

fn main() -> Result<(), Failure> {
    let mut options = DenseOptions::default();
    let mut free = Vec::new();
    let mut list = std::env::args().skip(1);
    while let Some(argument) = list.next() {
        let mut value = || list.next().ok_or_else(|| format!("{argument} needs a value"));
        match argument.as_str() {
            "--pixels" => options.max_pixels = value()?.parse()?,
            "--sources" => options.max_sources = value()?.parse()?,
            "--cell" => options.cell_px = value()?.parse()?,
            "--cluster" => options.cluster_size = value()?.parse()?,
            _ => free.push(PathBuf::from(argument)),
        }
    }
    let [photos, model, out] =
        free.try_into().map_err(|_| "usage: dense_folder PHOTOS MODEL OUT [options]")?;
    let read = |name: &str| std::fs::read(model.join(name));
    let files = ColmapFiles {
        cameras: read("cameras.txt")?,
        images: read("images.txt")?,
        points: read("points3D.txt")?,
    };
    let model = read_colmap_text(&files)?;
    std::fs::create_dir_all(&out)?;
    let folder = Folder { path: &photos, model: &model };
    let clock = Clock::default();
    let shelf = MemoryShelf::default();
    let dense = reconstruct_dense(&model, &folder, &shelf, &options, &clock)?;
    let map_of = |image: &ImageId| depth_map(&model, &shelf, &options, *image);
    let all: Vec<DepthMap> = dense.images.iter().filter_map(map_of).collect();
    let [depth_s, fusion_s] = clock.seconds();
    let megapixels: f64 = all.iter().map(|map| map.depth.len() as f64 * 1e-6).sum();
    println!(
        "{} depth maps of {megapixels:.2} MP: {:.2} CPU s per MP and {:.2} for fusion; {} points",
        all.len(),
        depth_s / megapixels,
        fusion_s / megapixels,
        dense.cloud.points.len()
    );
    std::fs::write(out.join("dense.ply"), write_ply_of_cloud(&dense.cloud))?;
    for map in &all {
        let name = Path::new(&model.images[&map.image].name).with_extension("depth");
        std::fs::write(out.join(name), bytes_of(map))?;
    }
    Ok(())
}

/// Seconds of CPU per stage.
#[derive(Default)]
struct Clock(Mutex<[(f64, f64); 2]>);

impl Clock {
    fn seconds(&self) -> [f64; 2] {
        self.0.lock().map(|stages| stages.map(|(_, sum)| sum)).unwrap_or_default()
    }
}

impl Progress for Clock {
    fn report(&self, stage: Stage, _done: usize, _total: usize) {
        let now = cpu_s();
        let Ok(mut stages) = self.0.lock() else { return };
        let [depth, fusion] = &mut *stages;
        let last = depth.0.max(fusion.0);
        let running = if stage == Stage::Fusion { fusion } else { depth };
        *running = (now, running.1 + now - last);
    }
}

fn bytes_of(map: &DepthMap) -> Vec<u8> {
    let size = [map.width() as u32, map.height() as u32];
    let mut bytes: Vec<u8> = size.iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend(map.depth.iter().flat_map(|v| v.to_le_bytes()));
    bytes.extend(&map.confidence);
    bytes.extend(map.inferred.iter().map(|&inferred| u8::from(inferred)));
    bytes
}

/// Seconds of CPU of this process so far, all threads (Linux).
fn cpu_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or("").split_whitespace().collect();
    let ticks = |i: usize| fields.get(i).and_then(|f| f.parse::<f64>().ok()).unwrap_or(0.0);
    (ticks(11) + ticks(12)) / 100.0
}
