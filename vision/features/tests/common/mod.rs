//! Images drawn by rule, for tests and for training.
#![allow(dead_code, unreachable_pub, missing_docs)]

use volery_scene::GrayImage;

/// SplitMix64.
pub struct Random(pub u64);

impl Random {
    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 24) as f32
    }

    /// Uniform in [low, high).
    pub fn range(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.unit()
    }
}

/// Gray values 0 to 255, row-major.
pub struct Canvas {
    pub width: usize,
    pub height: usize,
    pub values: Vec<f32>,
}

impl Canvas {
    pub fn new(width: usize, height: usize, gray: f32) -> Self {
        Self { width, height, values: vec![gray; width * height] }
    }

    /// `paint(x, y, old)` at every pixel center.
    pub fn paint(&mut self, mut paint: impl FnMut(f32, f32, f32) -> f32) {
        for (i, value) in self.values.iter_mut().enumerate() {
            let (x, y) = ((i % self.width) as f32 + 0.5, (i / self.width) as f32 + 0.5);
            *value = paint(x, y, *value);
        }
    }

    /// Bilinear value at a position, pixel centers at half-integers; the border goes on.
    pub fn sample(&self, x: f32, y: f32) -> f32 {
        let (x, y) = (x - 0.5, y - 0.5);
        let (x0, y0) = (x.floor(), y.floor());
        let (fx, fy) = (x - x0, y - y0);
        let at = |x: f32, y: f32| {
            let x = x.clamp(0.0, self.width as f32 - 1.0) as usize;
            let y = y.clamp(0.0, self.height as f32 - 1.0) as usize;
            self.values[y * self.width + x]
        };
        at(x0, y0) * (1.0 - fx) * (1.0 - fy)
            + at(x0 + 1.0, y0) * fx * (1.0 - fy)
            + at(x0, y0 + 1.0) * (1.0 - fx) * fy
            + at(x0 + 1.0, y0 + 1.0) * fx * fy
    }

    pub fn to_image(&self) -> GrayImage {
        let bytes = self.values.iter().map(|v| v.round().clamp(0.0, 255.0) as u8).collect();
        GrayImage::new(self.width as u32, self.height as u32, bytes).unwrap()
    }
}

/// Boxes, bars, disks, strokes like letters, and stains, at many sizes and angles.
pub fn textured(width: usize, height: usize, seed: u64) -> Canvas {
    let mut random = Random(seed.wrapping_mul(0x5851_f42d_4c95_7f2d) ^ 0x1234_5678);
    let mut canvas = Canvas::new(width, height, random.range(80.0, 170.0));
    let area = (width * height) as f32;
    let num_shapes = (area / 260.0) as usize;
    for i in 0..num_shapes {
        // Large shapes first, small ones on top.
        let size = 70.0 * (1.0 - i as f32 / num_shapes as f32).powi(3) + random.range(1.2, 6.0);
        let center = [random.range(0.0, width as f32), random.range(0.0, height as f32)];
        let (sin, cos) = random.range(0.0, std::f32::consts::TAU).sin_cos();
        let aspect = random.range(0.12, 1.0);
        let (gray, kind, slope) =
            (random.range(15.0, 240.0), random.unit(), random.range(-0.6, 0.6));
        let x_range = (center[0] - size - 2.0).max(0.0) as usize
            ..((center[0] + size + 2.0).max(0.0) as usize).min(width);
        let y_range = (center[1] - size - 2.0).max(0.0) as usize
            ..((center[1] + size + 2.0).max(0.0) as usize).min(height);
        for y in y_range {
            for x in x_range.clone() {
                let d = [x as f32 + 0.5 - center[0], y as f32 + 0.5 - center[1]];
                let (u, v) = (cos * d[0] + sin * d[1], -sin * d[0] + cos * d[1]);
                let outside = if kind < 0.6 {
                    (u.abs() - size).max(v.abs() - size * aspect)
                } else if kind < 0.8 {
                    u.hypot(v / aspect) - size
                } else {
                    (u.hypot(v) - 0.8 * size).abs() - 0.2 * size * aspect
                };
                // One pixel of soft edge.
                let cover = (0.5 - outside).clamp(0.0, 1.0);
                let value = &mut canvas.values[y * width + x];
                *value += cover * (gray + slope * u - *value);
            }
        }
    }
    canvas
}
