//! Meshes a PLY cloud with normals: `mesh_cloud CLOUD.ply OUT.(ply|glb) [options]`.
//!
//! * `--depth N`, `--screening A`, `--samples N`: see `PoissonOptions`.
//! * `--trim RATIO`: cut off where the density is below RATIO of the median.
//! * `--max-hole AREA`, `--min-part AREA`: keep small holes filled, drop small parts.
//! * `--triangles N`: decimate to N triangles.
//! * `--color`: colors of the vertices from the cloud.
//! * `--photos FOLDER`, `--model FOLDER`: a texture from photos with poses, those of COLMAP's
//!   `cameras.txt`, `images.txt` and `points3D.txt`; `OUT` must be a GLB.
//! * `--side N`: longest side of the texture.
//! * `--depths FOLDER`: depth maps as `dense_folder` writes them, for the images of `--model`: what
//!   their lines of sight do not end at is cut off.
//!
//! Prints seconds per step and the figures of the mesh.

use std::path::{Path, PathBuf};
use std::time::Instant;

use volery_formats::colmap::read_colmap_text;
use volery_formats::{
    ColmapFiles, DecodeLimits, GlbMap, decode_image, read_ply, write_glb_of_mesh,
    write_glb_of_textured_mesh, write_ply_of_mesh,
};
use volery_geometry::{Camera, CameraModel};
use volery_meshing::{
    PoissonOptions, SightVotes, TextureOptions, TrimOptions, color_vertices, decimate,
    reconstruct_surface, texture_mesh, trim,
};
use volery_scene::{
    DepthMap, ImageId, NoProgress, OrientedPoint, Photo, Photos, PointCloud, SparseModel,
    TriangleMesh,
};

const JPEG_QUALITY: u8 = 85;
/// What the files say of the scene.
const METRIC: GlbMap<'_> = GlbMap { id: None, is_metric: true, origin: None };

type Error = Box<dyn std::error::Error>;

#[derive(Default)]
struct Arguments {
    files: Vec<PathBuf>,
    poisson: PoissonOptions,
    trim: Option<TrimOptions>,
    num_triangles: Option<usize>,
    color: bool,
    photos: Option<PathBuf>,
    model: Option<PathBuf>,
    texture: TextureOptions,
    depths: Option<PathBuf>,
}

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

/// Lets the depth maps of a folder vote, one after the other.
fn votes(mesh: &TriangleMesh, model: &SparseModel, folder: &Path) -> Result<SightVotes, Error> {
    let mut votes = SightVotes::new(mesh.vertices.len());
    for (&id, image) in &model.images {
        let bytes = std::fs::read(folder.join(Path::new(&image.name).with_extension("depth")))?;
        let word = |i: usize| <[u8; 4]>::try_from(&bytes[4 * i..4 * i + 4]);
        let [width, height] = [u32::from_le_bytes(word(0)?), u32::from_le_bytes(word(1)?)];
        let camera = &model.cameras[&image.camera];
        let scale = f64::from(width) / f64::from(camera.width);
        let (f, c) = (camera.focal() * scale, camera.principal_point() * scale);
        let camera = Camera::new(CameraModel::Pinhole, width, height, &[f.x, f.y, c.x, c.y])?;
        let mut map = DepthMap::empty(id, camera, image.cam_from_world);
        for i in 0..map.depth.len() {
            map.depth[i] = f32::from_le_bytes(word(2 + i)?);
            map.inferred[i] = bytes[8 + 5 * map.depth.len() + i] != 0;
        }
        votes.add(&mesh.vertices, &map);
    }
    Ok(votes)
}

fn read_model(folder: &Path) -> Result<SparseModel, Error> {
    let read = |name: &str| std::fs::read(folder.join(name));
    let files = ColmapFiles {
        cameras: read("cameras.txt")?,
        images: read("images.txt")?,
        points: read("points3D.txt")?,
    };
    Ok(read_colmap_text(&files)?)
}

fn arguments() -> Result<Arguments, Error> {
    let mut found = Arguments::default();
    let mut list = std::env::args().skip(1);
    while let Some(argument) = list.next() {
        let mut value = || list.next().ok_or_else(|| format!("{argument} needs a value"));
        let mut trim = found.trim.unwrap_or_default();
        match argument.as_str() {
            "--depth" => found.poisson.depth = value()?.parse()?,
            "--screening" => found.poisson.screening = value()?.parse()?,
            "--samples" => found.poisson.samples_per_cell = value()?.parse()?,
            "--triangles" => found.num_triangles = Some(value()?.parse()?),
            "--color" => found.color = true,
            "--photos" => found.photos = Some(value()?.into()),
            "--depths" => found.depths = Some(value()?.into()),
            "--model" => found.model = Some(value()?.into()),
            "--side" => found.texture.max_side = value()?.parse()?,
            "--trim" => {
                trim.min_density_ratio = value()?.parse()?;
                found.trim = Some(trim);
            }
            "--max-hole" => {
                trim.max_hole_area = value()?.parse()?;
                found.trim = Some(trim);
            }
            "--min-part" => {
                trim.min_component_area = value()?.parse()?;
                found.trim = Some(trim);
            }
            _ => found.files.push(argument.into()),
        }
    }
    Ok(found)
}

fn read_cloud(path: &PathBuf) -> Result<PointCloud, Error> {
    let file = read_ply(&std::fs::read(path)?)?;
    if file.normals.len() != file.points.len() {
        return Err("the points have no normals".into());
    }
    let parts = file.points.iter().zip(&file.normals).zip(&file.colors);
    let points = parts.map(|((position, &normal), &color)| OrientedPoint {
        position: position.cast(),
        normal,
        color,
        confidence: u8::MAX,
        inferred: false,
    });
    Ok(PointCloud { points: points.collect() })
}

fn tell(what: &str, start: Instant, mesh: &TriangleMesh) {
    println!(
        "{what}: {} vertices, {} triangles, {:.3} s",
        mesh.vertices.len(),
        mesh.triangles.len(),
        start.elapsed().as_secs_f64()
    );
}

fn main() -> Result<(), Error> {
    let arguments = arguments()?;
    let [input, output] = &arguments.files[..] else {
        return Err("mesh_cloud CLOUD.ply OUT.(ply|glb) [options]".into());
    };
    let cloud = read_cloud(input)?;
    let start = Instant::now();
    let mut surface = reconstruct_surface(&cloud, &arguments.poisson, &NoProgress)?;
    tell("surface", start, &surface.mesh);
    if let (Some(depths), Some(model)) = (&arguments.depths, &arguments.model) {
        let start = Instant::now();
        let votes = votes(&surface.mesh, &read_model(model)?, depths)?;
        votes.discredit_unseen(&mut surface);
        tell("looked at", start, &surface.mesh);
    }
    if let Some(options) = &arguments.trim {
        let start = Instant::now();
        surface = trim(&surface, options);
        tell("trimmed", start, &surface.mesh);
    }
    let mut mesh = surface.mesh;
    if let Some(num_triangles) = arguments.num_triangles {
        let start = Instant::now();
        mesh = decimate(&mesh, num_triangles, &NoProgress)?;
        tell("decimated", start, &mesh);
    }
    if arguments.color {
        let start = Instant::now();
        color_vertices(&mut mesh, &cloud);
        tell("colored", start, &mesh);
    }
    if let (Some(photos), Some(model)) = (&arguments.photos, &arguments.model) {
        let model = read_model(model)?;
        let folder = Folder { path: photos, model: &model };
        let start = Instant::now();
        let textured = texture_mesh(&mesh, &model, &folder, &arguments.texture, &NoProgress)?;
        tell("textured", start, &textured.mesh);
        let texture = &textured.texture;
        println!(
            "texture of {} x {}, {} triangles seen",
            texture.width, texture.height, textured.num_textured
        );
        std::fs::write(output, write_glb_of_textured_mesh(&textured, &METRIC, JPEG_QUALITY)?)?;
        return Ok(());
    }
    let is_glb = output.extension().is_some_and(|extension| extension == "glb");
    let bytes = if is_glb { write_glb_of_mesh(&mesh, &METRIC) } else { write_ply_of_mesh(&mesh) };
    std::fs::write(output, bytes)?;
    Ok(())
}
