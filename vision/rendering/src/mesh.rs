//! A mesh made ready to be drawn many times.

use nalgebra::{Point3, Vector3};
use volery_scene::{TexturedMesh, TriangleMesh};

use crate::texture::Paint;

/// Most triangles and most vertices of a cluster.
pub(crate) const CLUSTER: usize = 128;
/// Bits per axis of the order in space.
const ORDER_BITS: u32 = 10;
/// Color of meshes without colors.
const PLAIN: [u8; 3] = [160; 3];

/// Why a mesh cannot be drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum MeshError {
    /// A triangle names a vertex that is not there.
    #[error("triangle {triangle} has a vertex that is not there")]
    MissingVertex {
        /// Position in the list.
        triangle: usize,
    },
    /// A coordinate is not finite.
    #[error("vertex {vertex} is not finite")]
    NotFinite {
        /// Position in the list.
        vertex: usize,
    },
    /// Places in the texture are not as many as the vertices, or the texture has no or too few
    /// pixels.
    #[error("the texture does not fit the mesh")]
    WrongTexture,
    /// The colors are not as many as the vertices, nor none.
    #[error("{num_colors} colors for {num_vertices} vertices")]
    WrongColors {
        /// Colors.
        num_colors: usize,
        /// Vertices.
        num_vertices: usize,
    },
}

/// Triangles in clusters that are near each other in space, so that those out of view are passed
/// over together. Both sides of a triangle are seen.
#[derive(Debug, Clone)]
pub struct DrawableMesh {
    /// Middle of the mesh; positions are relative to it.
    pub(crate) origin: Point3<f64>,
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) colors: Vec<[u8; 3]>,
    pub(crate) paint: Option<Paint>,
    /// In the order of the clusters.
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) clusters: Vec<Cluster>,
}

/// Some neighboring triangles with vertices of their own.
#[derive(Debug, Clone)]
pub(crate) struct Cluster {
    /// Number of the first triangle.
    pub(crate) first: u32,
    /// Corners, as numbers of the cluster's vertices.
    pub(crate) corners: Vec<[u8; 3]>,
    /// Relative to the mesh's origin: x, y, z; padded to whole vectors.
    pub(crate) positions: [Vec<f32>; 3],
    pub(crate) middle: Vector3<f32>,
    pub(crate) half: Vector3<f32>,
}

impl DrawableMesh {
    /// Prepares a mesh; triangles without area are left out.
    ///
    /// # Errors
    ///
    /// [`MeshError`] for indices, coordinates or colors that make no sense.
    pub fn new(mesh: &TriangleMesh) -> Result<Self, MeshError> {
        Ok(Self::with_flags(mesh, |_| false)?.0)
    }

    /// Prepares a mesh with a picture on it.
    ///
    /// # Errors
    ///
    /// As [`Self::new`], and [`MeshError::WrongTexture`].
    pub fn with_texture(textured: &TexturedMesh) -> Result<Self, MeshError> {
        let mut paint = Paint::new(textured)?;
        let is_textured = |triangle: usize| triangle < textured.num_textured;
        let (mut drawable, flags) = Self::with_flags(&textured.mesh, is_textured)?;
        paint.is_textured = flags;
        drawable.paint = Some(paint);
        Ok(drawable)
    }

    /// With a flag of each triangle, in the order of the clusters.
    fn with_flags(
        mesh: &TriangleMesh,
        flag: impl Fn(usize) -> bool,
    ) -> Result<(Self, Vec<bool>), MeshError> {
        check(mesh)?;
        let (origin, half) = bounds(mesh.vertices.iter().map(|v| v.coords));
        let relative = |v: &Point3<f64>| -> [f32; 3] { (v.coords - origin).cast::<f32>().into() };
        let positions: Vec<[f32; 3]> = mesh.vertices.iter().map(relative).collect();
        let colors = if mesh.colors.is_empty() {
            vec![PLAIN; mesh.vertices.len()]
        } else {
            mesh.colors.clone()
        };
        let mut ordered: Vec<(u32, [u32; 3], bool)> = mesh
            .triangles
            .iter()
            .enumerate()
            .filter(|(_, [a, b, c])| a != b && b != c && a != c)
            .map(|(number, t)| {
                let [a, b, c] = t.map(|v| Vector3::from(positions[v as usize]).cast::<f64>());
                (place_in_order(&((a + b + c) / 3.0), &half), *t, flag(number))
            })
            .collect();
        ordered.sort_by_key(|(place, ..)| *place);
        let (triangles, flags): (Vec<[u32; 3]>, _) =
            ordered.into_iter().map(|(_, t, flag)| (t, flag)).unzip();
        let clusters = clusters(&triangles, &positions);
        let origin = origin.into();
        Ok((Self { origin, positions, colors, paint: None, triangles, clusters }, flags))
    }

    /// Number of triangles.
    pub fn num_triangles(&self) -> usize {
        self.triangles.len()
    }
}

fn check(mesh: &TriangleMesh) -> Result<(), MeshError> {
    let num_vertices = mesh.vertices.len();
    let is_missing = |t: &[u32; 3]| t.iter().any(|&v| v as usize >= num_vertices);
    if let Some(triangle) = mesh.triangles.iter().position(is_missing) {
        return Err(MeshError::MissingVertex { triangle });
    }
    if let Some(vertex) = mesh.vertices.iter().position(|v| v.iter().any(|c| !c.is_finite())) {
        return Err(MeshError::NotFinite { vertex });
    }
    let num_colors = mesh.colors.len();
    if num_colors != 0 && num_colors != num_vertices {
        return Err(MeshError::WrongColors { num_colors, num_vertices });
    }
    Ok(())
}

/// Middle and half of the extent.
pub(crate) fn bounds(points: impl Iterator<Item = Vector3<f64>>) -> (Vector3<f64>, Vector3<f64>) {
    let none = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    let (low, high) = points.fold(none, |(low, high), p| (low.inf(&p), high.sup(&p)));
    if low.x > high.x {
        return (Vector3::zeros(), Vector3::zeros());
    }
    ((low + high) / 2.0, (high - low) / 2.0)
}

/// Place on a Z-shaped curve through the cells of a grid.
pub(crate) fn place_in_order(position: &Vector3<f64>, half: &Vector3<f64>) -> u32 {
    let cells = f64::from(1 << ORDER_BITS);
    let size = half.max().max(f64::MIN_POSITIVE);
    let cell = position.map(|v| ((v / size + 1.0) / 2.0 * cells).clamp(0.0, cells - 1.0) as u32);
    (0..ORDER_BITS).fold(0, |code, bit| {
        let digit = (cell.x >> bit & 1) | (cell.y >> bit & 1) << 1 | (cell.z >> bit & 1) << 2;
        code | digit << (3 * bit)
    })
}

fn clusters(triangles: &[[u32; 3]], positions: &[[f32; 3]]) -> Vec<Cluster> {
    const NONE: u32 = u32::MAX;
    // Cluster and number in it of the vertices met last.
    let mut known = vec![(NONE, 0_u8); positions.len()];
    let mut found = Vec::new();
    let mut first = 0;
    while first < triangles.len() {
        let id = found.len() as u32;
        let mut vertices: Vec<u32> = Vec::with_capacity(CLUSTER);
        let mut corners = Vec::with_capacity(CLUSTER);
        for triangle in &triangles[first..] {
            let num_new = triangle.iter().filter(|&&v| known[v as usize].0 != id).count();
            if corners.len() == CLUSTER || vertices.len() + num_new > CLUSTER {
                break;
            }
            corners.push(triangle.map(|v| {
                let entry = &mut known[v as usize];
                if entry.0 != id {
                    *entry = (id, vertices.len() as u8);
                    vertices.push(v);
                }
                entry.1
            }));
        }
        let points = || vertices.iter().map(|&v| Vector3::from(positions[v as usize]));
        let (middle, half) = bounds(points().map(|p| p.cast()));
        let padded = |axis: usize| {
            let mut values: Vec<f32> = points().map(|p| p[axis]).collect();
            values.resize(values.len().next_multiple_of(crate::simd::LANES), 0.0);
            values
        };
        let num = corners.len();
        found.push(Cluster {
            first: first as u32,
            corners,
            positions: [padded(0), padded(1), padded(2)],
            middle: middle.cast(),
            half: half.cast(),
        });
        first += num;
    }
    found
}
