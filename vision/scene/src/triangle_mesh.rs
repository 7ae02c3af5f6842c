//! Surfaces as triangles.

use nalgebra::Point3;

/// Triangles over shared vertices.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TriangleMesh {
    /// Positions.
    pub vertices: Vec<Point3<f64>>,
    /// Indices of vertices, counterclockwise seen from outside of the solid.
    pub triangles: Vec<[u32; 3]>,
    /// sRGB of the vertices; as many, or none.
    pub colors: Vec<[u8; 3]>,
}
