//! An image at several sizes.

use volery_scene::GrayImage;

/// Pixels around an image that repeat its edge: patches of points near it still fit.
pub(crate) const BORDER: usize = 16;
/// The smallest level is at least this wide, pixels.
const MIN_WIDTH: u32 = 60;
const MAX_LEVELS: usize = 6;

/// One size of an image. Pixel (x, y) has its center at (x + 0.5, y + 0.5).
pub(crate) struct Level {
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Of the plane with its border.
    pub(crate) stride: usize,
    /// Row by row, with the border.
    pub(crate) plane: Vec<f32>,
}

/// Level k is 2ᵏ times smaller than the image.
pub(crate) struct Pyramid {
    pub(crate) levels: Vec<Level>,
}

impl Pyramid {
    pub(crate) fn new(image: &GrayImage) -> Self {
        let (width, height) = (image.width() as usize, image.height() as usize);
        let mut first = Level::empty(width, height);
        for y in 0..height {
            let start = first.start_of_row(y);
            let row = &mut first.plane[start..start + width];
            for (out, &value) in row.iter_mut().zip(image.row(y as u32)) {
                *out = f32::from(value);
            }
        }
        first.repeat_edges();
        let mut levels = vec![first];
        while let Some(next) = levels.last().filter(|_| levels.len() < MAX_LEVELS) {
            if next.width.min(next.height) / 2 < MIN_WIDTH as usize * 3 / 4 {
                break;
            }
            levels.push(next.halved());
        }
        Self { levels }
    }
}

impl Level {
    fn empty(width: usize, height: usize) -> Self {
        let stride = width + 2 * BORDER;
        Self { width, height, stride, plane: vec![0.0; stride * (height + 2 * BORDER)] }
    }

    /// Index of the first pixel of row `y`.
    pub(crate) fn start_of_row(&self, y: usize) -> usize {
        (y + BORDER) * self.stride + BORDER
    }

    fn repeat_edges(&mut self) {
        for row in self.plane.chunks_exact_mut(self.stride).skip(BORDER).take(self.height) {
            let (first, last) = (row[BORDER], row[BORDER + self.width - 1]);
            row[..BORDER].fill(first);
            row[BORDER + self.width..].fill(last);
        }
        let (top, bottom) = (BORDER * self.stride, (BORDER + self.height - 1) * self.stride);
        for y in 0..BORDER {
            self.plane.copy_within(top..top + self.stride, y * self.stride);
            let below = (BORDER + self.height + y) * self.stride;
            self.plane.copy_within(bottom..bottom + self.stride, below);
        }
    }

    /// Half the size, by the filter (1 3 3 1)/8 each way, which keeps pixel corners on corners.
    fn halved(&self) -> Self {
        let mut half = Self::empty(self.width / 2, self.height / 2);
        let mut rows = vec![0.0_f32; self.stride];
        for y in 0..half.height {
            let top = self.start_of_row(2 * y) - BORDER - self.stride;
            let part = |k: usize| &self.plane[top + k * self.stride..top + (k + 1) * self.stride];
            let (a, b, c, d) = (part(0), part(1), part(2), part(3));
            for (x, out) in rows.iter_mut().enumerate() {
                *out = a[x] + d[x] + 3.0 * (b[x] + c[x]);
            }
            let start = half.start_of_row(y);
            let out = &mut half.plane[start..start + half.width];
            for (x, out) in out.iter_mut().enumerate() {
                let v = &rows[BORDER + 2 * x - 1..BORDER + 2 * x + 3];
                *out = (v[0] + v[3] + 3.0 * (v[1] + v[2])) * (1.0 / 64.0);
            }
        }
        half.repeat_edges();
        half
    }

    /// Value at a place in pixels, by its four neighbors; places beyond the border are moved to it.
    pub(crate) fn sample(&self, x: f32, y: f32) -> f32 {
        let margin = BORDER as f32;
        let u = (x - 0.5 + margin).clamp(0.0, (self.stride - 2) as f32);
        let last = self.height + 2 * BORDER - 2;
        let v = (y - 0.5 + margin).clamp(0.0, last as f32);
        let (i, j) = (u as usize, v as usize);
        let (a, b) = (u - i as f32, v - j as f32);
        let at = j * self.stride + i;
        let (above, below) = (&self.plane[at..at + 2], &self.plane[at + self.stride..]);
        let top = above[0] + a * (above[1] - above[0]);
        let bottom = below[0] + a * (below[1] - below[0]);
        top + b * (bottom - top)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A slope stays a slope, at the right place: dies with a shift by half a pixel.
    #[test]
    fn levels_lie_on_each_other() {
        let pixels = (0..200 * 240).map(|k| ((k % 240) / 2 + (k / 240) / 2) as u8).collect();
        let image = GrayImage::new(240, 200, pixels).unwrap();
        let pyramid = Pyramid::new(&image);
        assert!(pyramid.levels.len() > 1);
        for (k, level) in pyramid.levels.iter().enumerate() {
            let scale = (1 << k) as f32;
            for (x, y) in [(60.0, 50.0), (101.0, 81.5), (140.3, 111.7)] {
                let value = level.sample(x / scale, y / scale);
                // Whole numbers of half the coordinates: a quarter less than the slope on average.
                let expected = (x - 0.5 + y - 0.5) / 2.0 - 0.5;
                assert!((value - expected).abs() < 0.6, "level {k}: {value}, not {expected}");
            }
        }
    }

    #[test]
    fn places_outside_show_the_edge() {
        let pixels = (0..64 * 64).map(|k| if k % 64 < 32 { 10 } else { 200 }).collect();
        let pyramid = Pyramid::new(&GrayImage::new(64, 64, pixels).unwrap());
        let level = &pyramid.levels[0];
        assert_eq!(level.sample(-300.0, -300.0), 10.0);
        assert_eq!(level.sample(300.0, 300.0), 200.0);
    }
}
