//! Smaller images.

use volery_scene::GrayImage;

/// Size of `width` x `height` reduced to `max_side`, sides rounded, never enlarged, never zero.
pub fn downscaled_size(width: u32, height: u32, max_side: u32) -> (u32, u32) {
    let longest = width.max(height);
    if longest <= max_side {
        return (width, height);
    }
    let side = |s: u32| {
        let scaled = (f64::from(s) * f64::from(max_side) / f64::from(longest)).round();
        (scaled as u32).max(1)
    };
    (side(width), side(height))
}

/// The image with its longer side reduced to `max_side`, each pixel the area average of what it
/// covers; `None` if it is small enough already.
///
/// A pixel (x, y) of the result (first center (0.5, 0.5)) is (x · width / result width, y · height
/// / result height) of the original.
pub fn downscale_to_max_side(image: &GrayImage, max_side: u32) -> Option<GrayImage> {
    let (width, height) = downscaled_size(image.width(), image.height(), max_side.max(1));
    if (width, height) == (image.width(), image.height()) {
        return None;
    }
    let columns = coverage(image.width(), width);
    let rows = coverage(image.height(), height);
    let mut pixels = Vec::with_capacity(width as usize * height as usize);
    let mut sums = vec![0.0_f32; image.width() as usize];
    for row in &rows {
        sums.fill(0.0);
        for (y, weight) in row.weights() {
            for (sum, &value) in sums.iter_mut().zip(image.row(y as u32)) {
                *sum += weight * f32::from(value);
            }
        }
        for column in &columns {
            let sum: f32 = column.weights().map(|(x, weight)| weight * sums[x]).sum();
            pixels.push((sum + 0.5).clamp(0.0, 255.0) as u8);
        }
    }
    GrayImage::new(width, height, pixels)
}

/// The source pixels that one target pixel covers, with weights that sum to one.
struct Coverage {
    first: usize,
    last: usize,
    first_weight: f32,
    inner_weight: f32,
    last_weight: f32,
}

impl Coverage {
    fn weights(&self) -> impl Iterator<Item = (usize, f32)> + '_ {
        (self.first..=self.last).map(|i| {
            let weight = if i == self.first {
                self.first_weight
            } else if i == self.last {
                self.last_weight
            } else {
                self.inner_weight
            };
            (i, weight)
        })
    }
}

fn coverage(source: u32, target: u32) -> Vec<Coverage> {
    let step = f64::from(source) / f64::from(target);
    (0..target)
        .map(|i| {
            let (start, end) = (f64::from(i) * step, f64::from(i + 1) * step);
            let first = start as usize;
            // An end on a boundary covers nothing of the pixel beyond it.
            let last = ((end - 1e-9).ceil() as usize - 1).clamp(first, source as usize - 1);
            let part = |from: f64, to: f64| ((to - from) / step) as f32;
            Coverage {
                first,
                last,
                first_weight: part(start, end.min(first as f64 + 1.0)),
                inner_weight: part(0.0, 1.0),
                last_weight: part(start.max(last as f64), end),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halving_averages_two_by_two() {
        let image = GrayImage::new(4, 2, vec![0, 10, 100, 200, 20, 30, 100, 200]).unwrap();
        let half = downscale_to_max_side(&image, 2).unwrap();
        assert_eq!((half.width(), half.height()), (2, 1));
        assert_eq!(half.pixels(), [15, 150]);
    }

    /// The mean brightness of any image survives any factor, and a constant stays constant.
    #[test]
    fn brightness_is_kept() {
        for (width, height, max_side) in [(37, 53, 20), (100, 10, 99), (7, 300, 1), (64, 48, 33)] {
            let flat = GrayImage::new(width, height, vec![77; (width * height) as usize]).unwrap();
            let small = downscale_to_max_side(&flat, max_side).unwrap();
            assert!(small.pixels().iter().all(|&p| p == 77), "{width} x {height} to {max_side}");
        }
        let ramp: Vec<u8> = (0..90 * 90).map(|i| (i % 90 * 2) as u8).collect();
        let image = GrayImage::new(90, 90, ramp).unwrap();
        let small = downscale_to_max_side(&image, 31).unwrap();
        let mean = |i: &GrayImage| {
            i.pixels().iter().map(|&p| f64::from(p)).sum::<f64>() / i.pixels().len() as f64
        };
        assert!((mean(&image) - mean(&small)).abs() < 0.5);
    }

    /// A point keeps its place under the stated mapping of pixel coordinates.
    #[test]
    fn coordinates_scale_about_the_corner() {
        let mut pixels = vec![0; 90 * 60];
        pixels[30 * 90 + 45] = 255; // center (45.5, 30.5)
        let image = GrayImage::new(90, 60, pixels).unwrap();
        let small = downscale_to_max_side(&image, 45).unwrap();
        let brightest = (0..small.pixels().len()).max_by_key(|&i| small.pixels()[i]).unwrap();
        let (x, y) = (brightest % 45, brightest / 45);
        assert_eq!((x, y), (45 / 2, 30 / 2));
    }

    #[test]
    fn never_enlarged_never_empty() {
        let image = GrayImage::new(3, 2, vec![1; 6]).unwrap();
        assert_eq!(downscale_to_max_side(&image, 3), None);
        assert_eq!(downscaled_size(10_000, 1, 100), (100, 1));
    }
}
