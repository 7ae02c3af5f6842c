//! Surfaces as points.

use nalgebra::{Point3, Vector3};

/// A point of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientedPoint {
    /// In the frame of the model.
    pub position: Point3<f32>,
    /// Unit, out of the solid.
    pub normal: Vector3<f32>,
    /// sRGB.
    pub color: [u8; 3],
    /// From 0 to 255.
    pub confidence: u8,
    /// Whether it was concluded from its surroundings and not seen.
    pub inferred: bool,
}

/// Oriented points of one frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PointCloud {
    /// In no order.
    pub points: Vec<OrientedPoint>,
}
