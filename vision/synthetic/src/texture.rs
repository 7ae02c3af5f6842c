//! Prefiltered color textures on flat surfaces.

use nalgebra::Vector2;

/// Most probes along the long axis of a footprint.
const MAX_PROBES: f32 = 8.0;

/// A rectangle of colored texels with its pyramid of halved copies.
///
/// Texel `(i, j)` of level 0 covers `[i, i + 1) x [j, j + 1)` times the texel size. Level k + 1
/// halves level k; texels past the edge repeat it, so that no level is shifted against another.
#[derive(Debug, Clone)]
pub struct Texture {
    levels: Vec<Level>,
    texels_per_meter: f32,
}

#[derive(Debug, Clone)]
struct Level {
    width: usize,
    height: usize,
    texels: Vec<[u8; 4]>,
}

/// What a pixel covers on a surface: two half-open sides of a parallelogram, meters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footprint {
    /// Step on the surface per pixel to the right.
    pub along_x: Vector2<f32>,
    /// Step on the surface per pixel down.
    pub along_y: Vector2<f32>,
}

impl Texture {
    /// A texture of `width` columns of colors, 0..255, row by row.
    pub fn new(width: usize, colors: &[[u8; 3]], texel: f64) -> Self {
        let width = width.max(1);
        let mut texels: Vec<[u8; 4]> = colors.iter().map(|c| [c[0], c[1], c[2], 0]).collect();
        let height = (texels.len() / width).max(1);
        texels.resize(width * height, [0; 4]);
        let mut levels = vec![Level { width, height, texels }];
        while let Some(last) = levels.last()
            && last.width.max(last.height) > 1
        {
            levels.push(last.halved());
        }
        Self { levels, texels_per_meter: (1.0 / texel) as f32 }
    }

    /// Mean color over a footprint around `at` (meters from the texture's first corner): trilinear
    /// probes along the long axis.
    pub fn sample(&self, at: Vector2<f32>, footprint: &Footprint) -> [f32; 3] {
        let scale = self.texels_per_meter;
        let (x, y) = (footprint.along_x * scale, footprint.along_y * scale);
        let (long, short) = if x.norm_squared() >= y.norm_squared() { (x, y) } else { (y, x) };
        let long_norm = long.norm();
        // Width across the long axis, so that sheared footprints are not over-blurred.
        let across = (long.perp(&short).abs() / long_norm.max(1e-12)).max(1e-3);
        let num_probes = (long_norm / across).ceil().clamp(1.0, MAX_PROBES);
        let (level, blend) = split_log2(across.max(long_norm / num_probes));
        let center = at * scale;
        let mut sum = [0.0; 3];
        for k in 0..num_probes as usize {
            let offset = (k as f32 + 0.5) / num_probes - 0.5;
            let color = self.trilinear(center + long * offset, level, blend);
            (0..3).for_each(|c| sum[c] += color[c]);
        }
        sum.map(|v| v / num_probes)
    }

    fn trilinear(&self, at: Vector2<f32>, level: usize, blend: f32) -> [f32; 3] {
        let last = self.levels.len() - 1;
        let fine = level.min(last);
        let a = self.levels[fine].bilinear(at * (1.0 / (1u64 << fine) as f32));
        if blend == 0.0 || fine == last {
            return a;
        }
        let b = self.levels[fine + 1].bilinear(at * (1.0 / (1u64 << (fine + 1)) as f32));
        std::array::from_fn(|c| a[c] + blend * (b[c] - a[c]))
    }
}

impl Level {
    fn halved(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut texels = Vec::with_capacity(width * height);
        for j in 0..height {
            let row0 = 2 * j * self.width;
            let row1 = (2 * j + 1).min(self.height - 1) * self.width;
            for i in 0..width {
                let (i0, i1) = (2 * i, (2 * i + 1).min(self.width - 1));
                let four = [row0 + i0, row0 + i1, row1 + i0, row1 + i1];
                let sum =
                    |c: usize| four.iter().map(|&t| u16::from(self.texels[t][c])).sum::<u16>();
                texels.push(std::array::from_fn(|c| ((sum(c) + 2) / 4) as u8));
            }
        }
        Self { width, height, texels }
    }

    fn bilinear(&self, at: Vector2<f32>) -> [f32; 3] {
        let x = (at.x - 0.5).clamp(0.0, (self.width - 1) as f32);
        let y = (at.y - 0.5).clamp(0.0, (self.height - 1) as f32);
        let (i, j) = (x as usize, y as usize);
        let (fx, fy) = (x - i as f32, y - j as f32);
        let right = usize::from(i + 1 < self.width);
        let down = if j + 1 < self.height { self.width } else { 0 };
        let start = j * self.width + i;
        let (a, b) = (self.texels[start], self.texels[start + right]);
        let (c, d) = (self.texels[start + down], self.texels[start + down + right]);
        std::array::from_fn(|k| {
            let top = f32::from(a[k]) + fx * (f32::from(b[k]) - f32::from(a[k]));
            let bottom = f32::from(c[k]) + fx * (f32::from(d[k]) - f32::from(c[k]));
            top + fy * (bottom - top)
        })
    }
}

/// Whole and remaining part of log2, the latter linear in the mantissa; 0 below 1.
fn split_log2(value: f32) -> (usize, f32) {
    if value <= 1.0 {
        return (0, 0.0);
    }
    let bits = value.to_bits();
    let exponent = (bits >> 23) as usize - 127;
    let mantissa = f32::from_bits((bits & 0x007f_ffff) | 0x3f80_0000);
    (exponent.min(30), mantissa - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn footprint(size: f32) -> Footprint {
        Footprint { along_x: Vector2::new(size, 0.0), along_y: Vector2::new(0.0, size) }
    }

    /// 64 x 64 texels of 1 cm with a linear ramp in both directions.
    fn ramp() -> Texture {
        let colors: Vec<_> =
            (0..64 * 64).map(|t| [(2 * (t % 64)) as u8, (3 * (t / 64)) as u8, 100]).collect();
        Texture::new(64, &colors, 0.01)
    }

    /// A ramp is its own mean, so every footprint gives the same value: no level is shifted.
    #[test]
    fn a_ramp_is_exact_at_every_footprint() {
        let texture = ramp();
        for size in [0.001, 0.01, 0.013, 0.02, 0.035] {
            let at = Vector2::new(0.32, 0.30);
            let [r, g, b] = texture.sample(at, &footprint(size));
            assert!((r - 2.0 * 31.5).abs() < 0.6, "{size}: {r}");
            assert!((g - 3.0 * 29.5).abs() < 0.6, "{size}: {g}");
            assert_eq!(b, 100.0);
        }
    }

    #[test]
    fn a_stretched_footprint_blurs_along_its_long_axis_only() {
        // Stripes of two texels, one direction.
        let stripes = |across_x: bool| {
            let colors: Vec<_> = (0..64 * 64)
                .map(|t| {
                    if (if across_x { t % 64 } else { t / 64 }) / 2 % 2 == 0 {
                        [200; 3]
                    } else {
                        [0; 3]
                    }
                })
                .collect();
            Texture::new(64, &colors, 0.01)
        };
        let long = Footprint { along_x: Vector2::new(0.08, 0.0), along_y: Vector2::new(0.0, 0.01) };
        // Middle of a bright stripe.
        let at = Vector2::new(0.33, 0.33);
        assert!((stripes(true).sample(at, &long)[0] - 100.0).abs() < 15.0);
        assert!(stripes(false).sample(at, &long)[0] > 190.0);
    }

    #[test]
    fn huge_footprints_and_far_points_stay_in_range() {
        let texture = ramp();
        for at in [Vector2::new(-5.0, 9.0), Vector2::new(1e6, -1e6), Vector2::new(0.3, 0.3)] {
            for size in [1e-9, 1.0, 1e6] {
                let color = texture.sample(at, &footprint(size));
                assert!(color.iter().all(|c| (0.0..=255.0).contains(c)));
            }
        }
    }
}
