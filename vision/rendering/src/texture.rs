//! Pictures on surfaces, in halved sizes so that far surfaces do not flicker.

use volery_scene::{Texture, TexturedMesh};

use crate::mesh::MeshError;

/// Levels at most: parts of an atlas lie side by side and run into each other when they get small.
const MAX_LEVELS: usize = 5;

/// The texture of a mesh.
#[derive(Debug, Clone)]
pub(crate) struct Paint {
    /// Per vertex, texels of the finest level.
    pub(crate) positions: Vec<[f32; 2]>,
    /// Per triangle, in the order of the clusters.
    pub(crate) is_textured: Vec<bool>,
    levels: Vec<Texture>,
}

impl Paint {
    pub(crate) fn new(textured: &TexturedMesh) -> Result<Self, MeshError> {
        let texture = &textured.texture;
        let num_pixels = texture.width as usize * texture.height as usize;
        let are_finite = textured.uvs.iter().flatten().all(|v| v.is_finite());
        if num_pixels == 0
            || texture.pixels.len() != num_pixels
            || textured.uvs.len() != textured.mesh.vertices.len()
            || !are_finite
        {
            return Err(MeshError::WrongTexture);
        }
        let size = [texture.width as f32, texture.height as f32];
        let mut levels = vec![texture.clone()];
        while let Some(last) = levels.last()
            && levels.len() < MAX_LEVELS
            && last.width.min(last.height) > 1
        {
            levels.push(halved(last));
        }
        Ok(Self {
            positions: textured.uvs.iter().map(|uv| [uv[0] * size[0], uv[1] * size[1]]).collect(),
            is_textured: Vec::new(),
            levels,
        })
    }

    /// Color at a position whose surroundings of `texels` go into one pixel.
    pub(crate) fn color(&self, [u, v]: [f32; 2], texels: f32) -> [u8; 3] {
        let level = (texels.max(1.0).log2() + 0.5) as usize;
        let level = level.min(self.levels.len() - 1);
        let scale = 1.0 / (1 << level) as f32;
        bilinear(&self.levels[level], u * scale, v * scale)
    }
}

fn halved(texture: &Texture) -> Texture {
    let (width, height) = (texture.width / 2, texture.height / 2);
    let stride = texture.width as usize;
    let mut pixels = Vec::with_capacity(width as usize * height as usize);
    for y in 0..height as usize {
        for x in 0..width as usize {
            let start = 2 * y * stride + 2 * x;
            let four = [0, 1, stride, stride + 1].map(|k| texture.pixels[start + k]);
            pixels.push([0, 1, 2].map(|c| {
                let sum: u16 = four.iter().map(|color| u16::from(color[c])).sum();
                ((sum + 2) / 4) as u8
            }));
        }
    }
    Texture { width, height, pixels }
}

fn bilinear(texture: &Texture, u: f32, v: f32) -> [u8; 3] {
    let (width, height) = (texture.width as usize, texture.height as usize);
    let x = (u - 0.5).clamp(0.0, (width - 1) as f32);
    let y = (v - 0.5).clamp(0.0, (height - 1) as f32);
    let (i, j) = (x as usize, y as usize);
    let (fx, fy) = (x - i as f32, y - j as f32);
    let right = usize::from(i + 1 < width);
    let down = if j + 1 < height { width } else { 0 };
    let start = j * width + i;
    let four = [0, right, down, down + right].map(|k| texture.pixels[start + k]);
    [0, 1, 2].map(|c| {
        let [a, b, p, q] = four.map(|color| f32::from(color[c]));
        let (top, bottom) = (a + fx * (b - a), p + fx * (q - p));
        (top + fy * (bottom - top) + 0.5) as u8
    })
}
