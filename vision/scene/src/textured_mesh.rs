//! Surfaces with a picture on them.

use crate::TriangleMesh;

/// A picture: sRGB, row by row.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Texture {
    /// Pixels per row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// As many as `width * height`.
    pub pixels: Vec<[u8; 3]>,
}

/// A mesh of which most triangles show parts of a texture.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TexturedMesh {
    /// A vertex is there once for every part of the texture that meets at it. Vertices have colors,
    /// too.
    pub mesh: TriangleMesh,
    /// Per vertex, where it lies in the texture: from (0, 0) at the upper left corner of the first
    /// pixel to (1, 1) at the lower right corner of the last one.
    pub uvs: Vec<[f32; 2]>,
    /// The first so many triangles show the texture; the rest, which no photo shows, the colors of
    /// their vertices.
    pub num_textured: usize,
    /// The picture.
    pub texture: Texture,
}
