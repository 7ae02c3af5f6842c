//! The other images: where a pixel of the reference image lands in them.

use nalgebra::{Isometry3, Matrix3, Vector3};
use volery_geometry::Camera;
use volery_scene::GrayImage;

/// Bilinear samples by one load: each entry holds the pixel, its right and its lower neighbors, in
/// bytes from the lowest: `(x, y), (x+1, y), (x, y+1), (x+1, y+1)`.
#[derive(Debug, Clone)]
pub(crate) struct QuadImage {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) quads: Vec<u32>,
}

impl QuadImage {
    pub(crate) fn new(image: &GrayImage) -> Self {
        let (width, height) = (image.width() as usize, image.height() as usize);
        let mut quads = Vec::with_capacity(width * height);
        for y in 0..height {
            let top = image.row(y as u32);
            let bottom = image.row((y + 1).min(height - 1) as u32);
            for x in 0..width {
                let right = (x + 1).min(width - 1);
                let bytes = [top[x], top[right], bottom[x], bottom[right]];
                quads.push(u32::from_le_bytes(bytes));
            }
        }
        Self { width, height, quads }
    }
}

/// The map from pixels of one image with inverse depth to pixels of another.
///
/// ```text
/// λ (u', v', 1) = A (u, v, 1) + b w,   A = K' R K⁻¹,  b = K' t,  depth' = λ / w
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Transfer {
    /// Columns of A.
    pub(crate) a: [[f32; 3]; 3],
    pub(crate) b: [f32; 3],
}

impl Transfer {
    pub(crate) fn new(
        source: &Camera,
        target: &Camera,
        target_from_source: &Isometry3<f64>,
    ) -> Self {
        let source_inverse = source
            .calibration_matrix()
            .try_inverse()
            .expect("focal lengths of a checked camera are positive");
        let k = target.calibration_matrix();
        let rotation = target_from_source.rotation.to_rotation_matrix();
        let a: Matrix3<f64> = k * rotation.matrix() * source_inverse;
        let b: Vector3<f64> = k * target_from_source.translation.vector;
        Self { a: a.cast::<f32>().into(), b: b.cast::<f32>().into() }
    }

    /// `λ (u', v', 1)`.
    pub(crate) fn apply(&self, u: f32, v: f32, w: f32) -> [f32; 3] {
        let [a0, a1, a2] = &self.a;
        std::array::from_fn(|k| a0[k] * u + a1[k] * v + a2[k] + self.b[k] * w)
    }
}

/// Another image at one size, seen from the reference image.
#[derive(Debug, Clone)]
pub(crate) struct Source {
    pub(crate) image: QuadImage,
    pub(crate) from_reference: Transfer,
    pub(crate) to_reference: Transfer,
}
