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

/// Texels with one more column and row, which repeat the last ones: every texel has a right and a
/// lower neighbor.
#[derive(Debug, Clone)]
struct Level {
    stride: usize,
    /// Place of the last texel.
    last: [f32; 2],
    texels: Vec<Texel>,
}

/// Red, green, blue and nothing: four lanes are quicker than three.
type Texel = [u8; 4];
type Color = [f32; 4];

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
        let mut texels: Vec<Texel> = colors.iter().map(|c| [c[0], c[1], c[2], 0]).collect();
        let height = (texels.len() / width).max(1);
        texels.resize(width * height, [0; 4]);
        let mut size = [width, height];
        let mut levels = vec![Level::new(size, &texels)];
        while size[0].max(size[1]) > 1 {
            (size, texels) = halved(size, &texels);
            levels.push(Level::new(size, &texels));
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
        let last = self.levels.len() - 1;
        let fine = &self.levels[level.min(last)];
        let coarse = (blend > 0.0 && level < last).then(|| &self.levels[level + 1]);
        let per_texel = |level: usize| 1.0 / (1_u64 << level.min(last)) as f32;
        let (to_fine, to_coarse) = (per_texel(level), per_texel(level + 1));
        let center = at * scale;
        let mut sum: Color = [0.0; 4];
        for k in 0..num_probes as usize {
            let offset = (k as f32 + 0.5) / num_probes - 0.5;
            let at = center + long * offset;
            let mut color = fine.bilinear(at * to_fine);
            if let Some(coarse) = coarse {
                color = mix(&color, &coarse.bilinear(at * to_coarse), blend);
            }
            sum = std::array::from_fn(|c| sum[c] + color[c]);
        }
        let [red, green, blue, _] = sum;
        [red, green, blue].map(|v| v / num_probes)
    }
}

impl Level {
    fn new([width, height]: [usize; 2], texels: &[Texel]) -> Self {
        let rows = texels.chunks_exact(width);
        let rows = rows.clone().chain(rows.last());
        let texels = rows.flat_map(|row| row.iter().chain(row.last())).copied().collect();
        Self { stride: width + 1, last: [width, height].map(|n| (n - 1) as f32), texels }
    }

    #[inline(always)]
    fn bilinear(&self, at: Vector2<f32>) -> Color {
        let x = (at.x - 0.5).clamp(0.0, self.last[0]);
        let y = (at.y - 0.5).clamp(0.0, self.last[1]);
        let (i, j) = (x as usize, y as usize);
        let start = j * self.stride + i;
        let upper = &self.texels[start..start + 2];
        let lower = &self.texels[start + self.stride..start + self.stride + 2];
        let row = |row: &[Texel]| mix(&row[0].map(f32::from), &row[1].map(f32::from), x - i as f32);
        mix(&row(upper), &row(lower), y - j as f32)
    }
}

#[inline(always)]
fn mix(a: &Color, b: &Color, part: f32) -> Color {
    std::array::from_fn(|c| a[c] + part * (b[c] - a[c]))
}

/// Half the size, rounded up, and the means of four.
fn halved([width, height]: [usize; 2], texels: &[Texel]) -> ([usize; 2], Vec<Texel>) {
    let half = [width.div_ceil(2), height.div_ceil(2)];
    let mut means = Vec::with_capacity(half[0] * half[1]);
    for j in 0..half[1] {
        let row0 = 2 * j * width;
        let row1 = (2 * j + 1).min(height - 1) * width;
        for i in 0..half[0] {
            let (i0, i1) = (2 * i, (2 * i + 1).min(width - 1));
            let four = [row0 + i0, row0 + i1, row1 + i0, row1 + i1];
            let sum = |c: usize| four.iter().map(|&t| u16::from(texels[t][c])).sum::<u16>();
            means.push(std::array::from_fn(|c| ((sum(c) + 2) / 4) as u8));
        }
    }
    (half, means)
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
