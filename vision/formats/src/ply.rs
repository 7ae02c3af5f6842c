//! Colored points as PLY.

use nalgebra::Point3;
use volery_scene::SparseModel;

/// Points with colors.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct PlyCloud {
    /// Positions.
    pub points: Vec<Point3<f64>>,
    /// sRGB; as many as points, white where the file has none.
    pub colors: Vec<[u8; 3]>,
}

/// Why a file was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PlyError {
    /// No or a broken header.
    #[error("not a PLY file: {0}")]
    Header(String),
    /// Fewer bytes than the header promises.
    #[error("PLY data end too early, at vertex {vertex}")]
    Truncated {
        /// The first vertex that is not whole.
        vertex: usize,
    },
    /// A field that is no finite number.
    #[error("PLY vertex {vertex} is not a finite number")]
    NotANumber {
        /// Which vertex.
        vertex: usize,
    },
}

/// Writes binary little endian: x, y, z as 32-bit floats and red, green, blue.
pub fn write_ply(cloud: &PlyCloud) -> Vec<u8> {
    let _ = cloud;
    todo!()
}

/// The points of a model in the order of their ids.
pub fn write_ply_of_model(model: &SparseModel) -> Vec<u8> {
    let points = model.points.values();
    write_ply(&PlyCloud {
        points: points.clone().map(|p| p.position).collect(),
        colors: points.map(|p| p.color).collect(),
    })
}

/// Reads the vertices of an ASCII or binary PLY of any byte order; other elements and properties
/// are skipped.
pub fn read_ply(bytes: &[u8]) -> Result<PlyCloud, PlyError> {
    let _ = bytes;
    todo!()
}
