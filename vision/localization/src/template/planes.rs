//! Small gray images: halves, local contrast, values between pixels.

use volery_scene::GrayImage;

/// Contrast below which an area has none, gray levels.
const NOISE: f32 = 4.0;
/// Gray levels per standard deviation of a normalized image.
const LEVELS: f32 = 40.0;
/// What a normalized image shows of nothing.
pub(crate) const MEAN: u8 = 128;

/// Means of two by two pixels.
pub(crate) fn halved(image: &GrayImage) -> GrayImage {
    shrunk(image, 2)
}

/// Means of `factor` by `factor` pixels; the rest at the far rims is left out.
pub(crate) fn shrunk(image: &GrayImage, factor: u32) -> GrayImage {
    let (width, height) = (image.width() / factor, image.height() / factor);
    let mut pixels = Vec::with_capacity(width as usize * height as usize);
    let mut sums = vec![0_u32; width as usize];
    let half = factor * factor / 2;
    for y in 0..height {
        sums.fill(0);
        for row in 0..factor {
            let row = image.row(y * factor + row);
            for (sum, part) in sums.iter_mut().zip(row.chunks_exact(factor as usize)) {
                *sum += part.iter().map(|&v| u32::from(v)).sum::<u32>();
            }
        }
        pixels.extend(sums.iter().map(|sum| ((sum + half) / (factor * factor)) as u8));
    }
    GrayImage::new(width, height, pixels).expect("as many as pixels")
}

/// The image relative to the mean and the contrast of its surroundings (to `radius` pixels), which takes slow changes of
/// light and its gamma away. `is_seen` tells which pixels count; the others become [`MEAN`].
pub(crate) fn normalized(
    image: &GrayImage,
    radius: usize,
    is_seen: impl Fn(usize) -> bool,
) -> GrayImage {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let stride = width + 1;
    // Integral images of the number, the sum and the sum of squares. They may wrap; what lies in the
    // surroundings of a pixel does not, below 65 536 pixels.
    let mut sums = vec![[0_u32; 3]; stride * (height + 1)];
    for y in 0..height {
        let mut row = [0_u32; 3];
        for x in 0..width {
            if is_seen(y * width + x) {
                let v = u32::from(image.pixels()[y * width + x]);
                row = [row[0] + 1, row[1] + v, row[2].wrapping_add(v * v)];
            }
            let above = sums[y * stride + x + 1];
            sums[(y + 1) * stride + x + 1] = [0, 1, 2].map(|k| above[k].wrapping_add(row[k]));
        }
    }
    let mut pixels = vec![MEAN; width * height];
    for y in 0..height {
        let (y0, y1) = (y.saturating_sub(radius), (y + radius + 1).min(height));
        for x in 0..width {
            if !is_seen(y * width + x) {
                continue;
            }
            let (x0, x1) = (x.saturating_sub(radius), (x + radius + 1).min(width));
            let at = |x: usize, y: usize| &sums[y * stride + x];
            let corners = [at(x1, y1), at(x0, y0), at(x0, y1), at(x1, y0)];
            let [num, sum, squares] = [0, 1, 2].map(|k| {
                let [a, b, c, d] = corners.map(|corner| corner[k]);
                u64::from(a.wrapping_add(b).wrapping_sub(c).wrapping_sub(d))
            });
            let scale = 1.0 / num as f32;
            let deviation = ((num * squares - sum * sum) as f32).sqrt() * scale;
            let v = u64::from(image.pixels()[y * width + x]);
            let v = ((num * v) as f32 - sum as f32) * scale;
            let level = f32::from(MEAN) + LEVELS * v / (deviation + NOISE);
            pixels[y * width + x] = (level + 0.5).clamp(1.0, 255.0) as u8;
        }
    }
    GrayImage::new(image.width(), image.height(), pixels).expect("as many as pixels")
}

/// Value between pixel centers and its derivatives along x and y; `None` outside.
#[inline]
pub(crate) fn sample(image: &GrayImage, u: f32, v: f32) -> Option<[f32; 3]> {
    let (x, y) = (u - 0.5, v - 0.5);
    let (width, height) = (image.width() as usize, image.height() as usize);
    // False for NaN.
    let is_within = x >= 0.0 && y >= 0.0 && x < width as f32 - 1.0 && y < height as f32 - 1.0;
    if !is_within {
        return None;
    }
    let (i, j) = (x as usize, y as usize);
    let (fx, fy) = (x - i as f32, y - j as f32);
    let rows = &image.pixels()[j * width + i..];
    let [a, b] = [rows[0], rows[1]].map(f32::from);
    let [c, d] = [rows[width], rows[width + 1]].map(f32::from);
    let (top, bottom) = (a + fx * (b - a), c + fx * (d - c));
    Some([top + fy * (bottom - top), (b - a) + fy * ((d - c) - (b - a)), bottom - top])
}
