//! What a virtual camera can draw of a map folder.

use std::{fs, path::Path};

use volery_formats::{read_glb_of_textured_mesh, read_ply, read_ply_of_mesh};
use volery_geometry::{Camera, Isometry3, KdTree, Point3, median};
use volery_rendering::{DrawableMesh, DrawablePoints, Rendering, VirtualCamera};

use crate::{error::PipelineError, map_folder::file};

/// Points whose distance to their neighbor gives the size of all.
const NUM_SAMPLED: usize = 2000;
/// Radius of a drawn point per distance of neighbors.
const RADIUS: f64 = 1.0;

/// The surface of a map, or points of it.
#[derive(Debug, Clone)]
pub enum Surface {
    /// Triangles.
    Mesh(Box<DrawableMesh>),
    /// Points of the dense cloud, or else of the sparse model.
    Points(DrawablePoints),
}

impl Surface {
    /// Reads the best that the folder holds.
    pub fn open(folder: &Path) -> Result<Self, PipelineError> {
        let read = |name: &str| {
            let path = folder.join(name);
            match fs::read(&path) {
                Ok(bytes) => Ok(Some((path, bytes))),
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(None),
                Err(error) => Err(PipelineError::io(&path, &error)),
            }
        };
        // The mesh with the photos on it, if there is one.
        if let Some((_, bytes)) = read(file::GLB)?
            && let Ok(textured) = read_glb_of_textured_mesh(&bytes)
            && let Ok(mesh) = DrawableMesh::with_texture(&textured)
        {
            return Ok(Self::Mesh(Box::new(mesh)));
        }
        if let Some((path, bytes)) = read(file::MESH)? {
            let mesh = read_ply_of_mesh(&bytes).map_err(|e| bad_surface(&path, &e))?;
            let mesh = DrawableMesh::new(&mesh).map_err(|e| bad_surface(&path, &e))?;
            return Ok(Self::Mesh(Box::new(mesh)));
        }
        let (path, bytes) = match read(file::DENSE)? {
            Some(dense) => dense,
            None => read(file::SPARSE)?.unwrap_or_default(),
        };
        let cloud = read_ply(&bytes).map_err(|e| bad_surface(&path, &e))?;
        let radius = RADIUS * spacing(&cloud.points);
        Ok(Self::Points(DrawablePoints { positions: cloud.points, colors: cloud.colors, radius }))
    }

    /// The mesh, if there is one.
    pub fn mesh(&self) -> Option<&DrawableMesh> {
        match self {
            Self::Mesh(mesh) => Some(mesh),
            Self::Points(_) => None,
        }
    }

    /// `mesh` or `points`.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Mesh(_) => "mesh",
            Self::Points(_) => "points",
        }
    }

    /// What a camera sees.
    pub fn draw(&self, camera: &Camera, cam_from_map: &Isometry3<f64>) -> Rendering {
        let eye = VirtualCamera::new(camera);
        match self {
            Self::Mesh(mesh) => eye.draw_mesh(mesh, cam_from_map),
            Self::Points(points) => eye.draw_points(points, cam_from_map),
        }
    }
}

/// Median distance of some points to their nearest neighbors; 0 for fewer than two points.
fn spacing(points: &[Point3<f64>]) -> f64 {
    let tree = KdTree::new(points);
    let mut found = Vec::new();
    let step = points.len().div_ceil(NUM_SAMPLED).max(1);
    let mut distances: Vec<f64> = points
        .iter()
        .step_by(step)
        .filter_map(|point| {
            tree.nearest(point, 2, &mut found);
            let neighbor = found.get(1)?;
            Some((points[neighbor.index as usize] - point).norm())
        })
        .collect();
    median(&mut distances).unwrap_or(0.0)
}

fn bad_surface(path: &Path, error: &dyn std::fmt::Display) -> PipelineError {
    PipelineError::new(
        crate::error::code::BAD_MAP,
        format!("{}: {error}", path.display()),
        "reconstruct the map again",
    )
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use volery_formats::write_ply_of_mesh;
    use volery_geometry::CameraModel;
    use volery_scene::TriangleMesh;

    use super::*;

    fn wall() -> TriangleMesh {
        TriangleMesh {
            vertices: [[-9.0, -9.0, 2.0], [9.0, -9.0, 2.0], [-9.0, 9.0, 2.0], [9.0, 9.0, 2.0]]
                .map(Point3::from)
                .into(),
            triangles: vec![[0, 1, 2], [1, 3, 2]],
            colors: vec![[10, 20, 30]; 4],
        }
    }

    /// The mesh is drawn where there is one, else points; a damaged file is said to be damaged.
    #[test]
    fn the_best_surface_is_drawn() {
        let folder = std::env::temp_dir().join(format!("volery-surface-{}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        let camera = Camera::from_focal(CameraModel::Pinhole, 32, 24, 20.0).unwrap();
        let pose = Isometry3::translation(0.0, 0.0, 0.0);
        fs::write(folder.join(file::SPARSE), write_ply_of_mesh(&wall())).unwrap();
        let points = Surface::open(&folder).unwrap();
        assert!(points.mesh().is_none() && points.name() == "points");
        let back = Isometry3::from_parts(Vector3::new(0.0, 0.0, 20.0).into(), pose.rotation);
        let drawn = points.draw(&camera, &back);
        let is_seen = |k: usize| drawn.depth[k] > 0.0;
        assert!(drawn.seen_part() > 0.0);
        assert!((0..32 * 24).all(|k| !is_seen(k) || drawn.colors[k] == [10, 20, 30]));
        fs::write(folder.join(file::MESH), write_ply_of_mesh(&wall())).unwrap();
        let mesh = Surface::open(&folder).unwrap();
        let drawn = mesh.draw(&camera, &pose);
        assert!(drawn.depth.iter().all(|&depth| (depth - 2.0).abs() < 1e-5));
        fs::write(folder.join(file::MESH), b"ply\nnonsense").unwrap();
        assert_eq!(Surface::open(&folder).unwrap_err().code, "bad_map");
        fs::remove_dir_all(&folder).unwrap();
    }
}
