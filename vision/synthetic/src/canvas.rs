//! A painter's canvas in meters: shapes with smooth edges, noise, lettering.

use nalgebra::Vector2;
use rayon::prelude::*;

use crate::Rng;
use volery_geometry::rng::mix;

/// Red, green, blue, 0..1 as displayed.
pub(crate) type Color = [f32; 3];

/// A rectangle being painted; x to the right, y down, meters.
pub(crate) struct Canvas {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) texel: f64,
    pub(crate) colors: Vec<Color>,
}

/// A frame of the plane in which lettering and shapes are drawn.
#[derive(Clone, Copy)]
pub(crate) struct Placement {
    pub(crate) origin: Vector2<f64>,
    pub(crate) cos: f64,
    pub(crate) sin: f64,
}

impl Placement {
    pub(crate) fn new(x: f64, y: f64, turn: f64) -> Self {
        Self { origin: Vector2::new(x, y), cos: turn.cos(), sin: turn.sin() }
    }

    fn to_canvas(self, x: f64, y: f64) -> Vector2<f64> {
        self.origin + Vector2::new(self.cos * x - self.sin * y, self.sin * x + self.cos * y)
    }

    fn to_local(self, p: Vector2<f64>) -> Vector2<f64> {
        let d = p - self.origin;
        Vector2::new(self.cos * d.x + self.sin * d.y, self.cos * d.y - self.sin * d.x)
    }
}

impl Canvas {
    pub(crate) fn new(width_m: f64, height_m: f64, texel: f64, color: Color) -> Self {
        let size = |meters: f64| ((meters / texel).ceil() as usize).max(1);
        let (width, height) = (size(width_m), size(height_m));
        Self { width, height, texel, colors: vec![color; width * height] }
    }

    /// Repaints every texel by its middle and its color.
    pub(crate) fn repaint(&mut self, paint: impl Fn(f64, f64, Color) -> Color + Sync) {
        let texel = self.texel;
        self.colors.par_chunks_mut(self.width).enumerate().for_each(|(j, row)| {
            let y = (j as f64 + 0.5) * texel;
            for (i, color) in row.iter_mut().enumerate() {
                *color = paint((i as f64 + 0.5) * texel, y, *color);
            }
        });
    }

    /// Lightens and darkens by fractal noise: `1 ± amplitude`, coarsest cells `cell` meters,
    /// halving `octaves` times.
    pub(crate) fn grain(&mut self, seed: u64, amplitude: f32, cell: Vector2<f64>, octaves: u32) {
        self.weave(seed, cell, octaves, |color, noise| {
            color.map(|c| c * (1.0 + amplitude * noise))
        });
    }

    /// Repaints every texel by its color and fractal noise.
    pub(crate) fn weave(
        &mut self,
        seed: u64,
        cell: Vector2<f64>,
        octaves: u32,
        paint: impl Fn(Color, f32) -> Color + Sync,
    ) {
        let (texel, width) = (self.texel, self.width);
        self.colors.par_chunks_mut(width).enumerate().for_each(|(j, row)| {
            let y = (j as f64 + 0.5) * texel / cell.y;
            let noise = fractal_noise_row(seed, texel / cell.x, y, octaves, width);
            for (color, noise) in row.iter_mut().zip(noise) {
                *color = paint(*color, noise);
            }
        });
    }

    /// Blends `color` where the signed distance (meters, negative inside) says so; only within
    /// `radius` of the placement's origin.
    fn shape(
        &mut self,
        place: Placement,
        radius: f64,
        color: Color,
        alpha: f32,
        distance: impl Fn(Vector2<f64>) -> f64,
    ) {
        let reach = radius + self.texel;
        let bound = |v: f64, n: usize| ((v / self.texel).max(0.0) as usize).min(n);
        let columns = bound(place.origin.x - reach, self.width)
            ..bound(place.origin.x + reach + self.texel, self.width);
        let rows = bound(place.origin.y - reach, self.height)
            ..bound(place.origin.y + reach + self.texel, self.height);
        for j in rows {
            for i in columns.clone() {
                let p = Vector2::new(i as f64 + 0.5, j as f64 + 0.5) * self.texel;
                let coverage = 0.5 - distance(place.to_local(p)) / self.texel;
                if coverage > 0.0 {
                    let a = alpha * coverage.min(1.0) as f32;
                    let old = &mut self.colors[j * self.width + i];
                    *old = std::array::from_fn(|c| old[c] + a * (color[c] - old[c]));
                }
            }
        }
    }

    /// A rectangle of half sizes `half` around the placement's origin.
    pub(crate) fn rect(&mut self, place: Placement, half: Vector2<f64>, color: Color, alpha: f32) {
        self.shape(place, half.norm(), color, alpha, |p| {
            (p.x.abs() - half.x).max(p.y.abs() - half.y)
        });
    }

    /// A rectangle from its corner and size in the frame of `place`.
    pub(crate) fn rect_at(&mut self, place: Placement, at: [f64; 4], color: Color, alpha: f32) {
        let [x, y, w, h] = at;
        let middle = Placement { origin: place.to_canvas(x + w / 2.0, y + h / 2.0), ..place };
        self.rect(middle, Vector2::new(w / 2.0, h / 2.0), color, alpha);
    }

    /// A disc, or a ring where `hole > 0`.
    pub(crate) fn disc(
        &mut self,
        place: Placement,
        radius: f64,
        hole: f64,
        color: Color,
        alpha: f32,
    ) {
        self.shape(place, radius, color, alpha, |p| (p.norm() - radius).max(hole - p.norm()));
    }

    /// A triangle with its tip up.
    pub(crate) fn triangle(&mut self, place: Placement, radius: f64, color: Color, alpha: f32) {
        let (sin, cos) = (0.5, 0.75_f64.sqrt());
        self.shape(place, radius, color, alpha, |p| {
            (p.y - radius / 2.0).max(p.x.abs() * cos - p.y * sin - radius / 2.0)
        });
    }

    /// A line of `thickness`.
    pub(crate) fn line(
        &mut self,
        from: [f64; 2],
        to: [f64; 2],
        thickness: f64,
        color: Color,
        alpha: f32,
    ) {
        let (a, b) = (Vector2::from(from), Vector2::from(to));
        let (d, middle) = (b - a, (a + b) / 2.0);
        let place = Placement::new(middle.x, middle.y, d.y.atan2(d.x));
        self.rect(place, Vector2::new(d.norm() / 2.0, thickness / 2.0), color, alpha);
    }

    /// A soft blot.
    pub(crate) fn blot(
        &mut self,
        x: f64,
        y: f64,
        radius: f64,
        color: Color,
        alpha: f32,
        seed: u64,
    ) {
        let place = Placement::new(x, y, 0.0);
        let texel = self.texel;
        self.shape(place, 1.5 * radius, color, alpha, move |p| {
            let ragged = f64::from(fractal_noise(seed, p.x / radius, p.y / radius, 3));
            // Soft over a third of the radius.
            (p.norm() - radius * (1.0 + 0.5 * ragged)) * (texel / (0.33 * radius)).min(1.0)
        });
    }

    /// Capital letters and digits of height `height` from the placement's origin (top left).
    pub(crate) fn text(&mut self, place: Placement, text: &str, height: f64, color: Color) {
        let cell = height / 5.0;
        for (index, letter) in text.chars().enumerate() {
            let rows = glyph(letter);
            for (row, bits) in rows.iter().enumerate() {
                for column in 0..3 {
                    if bits >> (2 - column) & 1 == 1 {
                        let x = (index * 4 + column) as f64 * cell;
                        // A hair of overlap hides the seams of neighboring cells.
                        let at = [x, row as f64 * cell, cell * 1.02, cell * 1.02];
                        self.rect_at(place, at, color, 1.0);
                    }
                }
            }
        }
    }
}

/// Width of `text` per its height.
pub(crate) fn text_aspect(text: &str) -> f64 {
    (text.chars().count() as f64 * 4.0 - 1.0) / 5.0
}

/// A word, a number or a shelf mark.
pub(crate) fn word(rng: &mut Rng) -> String {
    const WORDS: [&str; 32] = [
        "VOLERY",
        "FRAGILE",
        "THIS SIDE UP",
        "KEEP DRY",
        "HEAVY",
        "ZONE",
        "EXIT",
        "LOADING",
        "DANGER",
        "PARTS",
        "PUMPS",
        "VALVES",
        "NORTH",
        "STATION",
        "CAUTION",
        "FORKLIFT",
        "TOOLS",
        "RETURN",
        "CABLE",
        "GLASS",
        "BOLTS",
        "MOTOR",
        "PAINT",
        "SERVICE",
        "QUALITY",
        "STOCK",
        "EXPRESS",
        "ORIGIN",
        "WEIGHT",
        "HARBOR",
        "MEADOW",
        "KITE",
    ];
    let number = |rng: &mut Rng| 10 + rng.index(990);
    match rng.index(4) {
        0 => format!("{} {}", WORDS[rng.index(WORDS.len())], number(rng)),
        1 => {
            let letter = char::from(b'A' + rng.index(26) as u8);
            format!("{letter}{}", number(rng))
        }
        2 => format!("{}", number(rng) * 7919 % 1_000_000),
        _ => WORDS[rng.index(WORDS.len())].to_owned(),
    }
}

/// Rows of a 3 x 5 letter, the left column in the highest bit.
fn glyph(letter: char) -> [u8; 5] {
    match letter {
        'A' => [2, 5, 7, 5, 5],
        'B' => [6, 5, 6, 5, 6],
        'C' => [3, 4, 4, 4, 3],
        'D' => [6, 5, 5, 5, 6],
        'E' => [7, 4, 6, 4, 7],
        'F' => [7, 4, 6, 4, 4],
        'G' => [3, 4, 5, 5, 3],
        'H' => [5, 5, 7, 5, 5],
        'I' => [7, 2, 2, 2, 7],
        'J' => [1, 1, 1, 5, 2],
        'K' => [5, 6, 4, 6, 5],
        'L' => [4, 4, 4, 4, 7],
        'M' => [5, 7, 7, 5, 5],
        'N' => [6, 5, 5, 5, 5],
        'O' | '0' => [7, 5, 5, 5, 7],
        'P' => [6, 5, 6, 4, 4],
        'Q' => [2, 5, 5, 7, 3],
        'R' => [6, 5, 6, 5, 5],
        'S' | '5' => [7, 4, 7, 1, 7],
        'T' => [7, 2, 2, 2, 2],
        'U' => [5, 5, 5, 5, 7],
        'V' => [5, 5, 5, 5, 2],
        'W' => [5, 5, 7, 7, 5],
        'X' => [5, 5, 2, 5, 5],
        'Y' => [5, 5, 2, 2, 2],
        'Z' => [7, 1, 2, 4, 7],
        '1' => [2, 6, 2, 2, 7],
        '2' => [7, 1, 7, 4, 7],
        '3' => [7, 1, 3, 1, 7],
        '4' => [5, 5, 7, 1, 1],
        '6' => [4, 4, 7, 5, 7],
        '7' => [7, 1, 1, 2, 2],
        '8' => [7, 5, 7, 5, 7],
        '9' => [7, 5, 7, 1, 1],
        _ => [0; 5],
    }
}

/// Weight and frequency of the next octave, times those of the last.
const OCTAVE: (f32, f64) = (0.62, 2.03);
/// Weight of the first octave.
const FIRST_WEIGHT: f32 = 0.6;

/// Sum of halving octaves of value noise, about -1..1.
pub(crate) fn fractal_noise(seed: u64, x: f64, y: f64, octaves: u32) -> f32 {
    let (mut sum, mut weight, mut scale) = (0.0, FIRST_WEIGHT, 1.0);
    for octave in 0..octaves {
        let (seed, x, y) = (seed.wrapping_add(u64::from(octave)), x * scale, y * scale);
        let i = x.floor();
        let [left, right] = [0, 1].map(|side| column_value(seed, i as i64 + side, y));
        sum += weight * ease(left, right, (x - i) as f32);
        (weight, scale) = (weight * OCTAVE.0, scale * OCTAVE.1);
    }
    sum
}

/// [`fractal_noise`] at `x = (i + 0.5) step`, i in 0..n: a lattice cell is looked up once.
fn fractal_noise_row(seed: u64, step: f64, y: f64, octaves: u32, n: usize) -> Vec<f32> {
    let mut row = vec![0.0; n];
    let (mut weight, mut scale) = (FIRST_WEIGHT, 1.0);
    for octave in 0..octaves {
        let (seed, y) = (seed.wrapping_add(u64::from(octave)), y * scale);
        let mut cell = 0;
        let [mut left, mut right] = [0, 1].map(|side| column_value(seed, cell + side, y));
        for (k, value) in row.iter_mut().enumerate() {
            let x = (k as f64 + 0.5) * step * scale;
            while (cell + 1) as f64 <= x {
                cell += 1;
                (left, right) = (right, column_value(seed, cell + 1, y));
            }
            *value += weight * ease(left, right, (x - cell as f64) as f32);
        }
        (weight, scale) = (weight * OCTAVE.0, scale * OCTAVE.1);
    }
    row
}

/// Random values at the integers of column `i`, smoothly interpolated at `y`, -1..1.
fn column_value(seed: u64, i: i64, y: f64) -> f32 {
    let j = y.floor();
    ease(cell_value(seed, i, j as i64), cell_value(seed, i, j as i64 + 1), (y - j) as f32)
}

fn ease(a: f32, b: f32, s: f32) -> f32 {
    a + s * s * (3.0 - 2.0 * s) * (b - a)
}

/// Random value of a grid cell, -1..1.
pub(crate) fn cell_value(seed: u64, i: i64, j: i64) -> f32 {
    let cell = (i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ (j as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f);
    let bits = mix(seed.wrapping_mul(0xd6e8_feb8_6659_fd93) ^ cell);
    (bits >> 40) as f32 * (2.0 / (1u64 << 24) as f32) - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_of_noise_is_the_noise_of_its_points() {
        let row = fractal_noise_row(9, 0.13, 4.7, 6, 300);
        for (i, value) in row.iter().enumerate() {
            let point = fractal_noise(9, (i as f64 + 0.5) * 0.13, 4.7, 6);
            assert!((value - point).abs() < 1e-5);
        }
        assert!(row.iter().any(|v| *v > 0.2) && row.iter().any(|v| *v < -0.2));
    }

    /// Edges fall between texels and are covered in part, so shapes have their true area.
    #[test]
    fn shapes_have_their_area() {
        let area = |draw: &dyn Fn(&mut Canvas)| {
            let mut canvas = Canvas::new(1.0, 1.0, 0.01, [0.0; 3]);
            draw(&mut canvas);
            canvas.colors.iter().map(|c| f64::from(c[0])).sum::<f64>() * 1e-4
        };
        let place = Placement::new(0.503, 0.498, 0.4);
        let half = Vector2::new(0.2, 0.133);
        let rect = area(&|canvas| canvas.rect(place, half, [1.0; 3], 1.0));
        assert!((rect / (4.0 * half.x * half.y) - 1.0).abs() < 0.01, "{rect}");
        let disc = area(&|canvas| canvas.disc(place, 0.3, 0.1, [1.0; 3], 1.0));
        assert!((disc / (std::f64::consts::PI * 0.08) - 1.0).abs() < 0.01, "{disc}");
        // An equilateral triangle of circumradius r has 3 √3 / 4 r² area.
        let triangle = area(&|canvas| canvas.triangle(place, 0.3, [1.0; 3], 1.0));
        assert!((triangle / (0.75 * 3.0_f64.sqrt() * 0.09) - 1.0).abs() < 0.02, "{triangle}");
    }
}
