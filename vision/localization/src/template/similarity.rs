//! Template matching: where in an image a smaller one is found (P65).

use volery_geometry::SimdLevel;
use volery_scene::GrayImage;

use super::simd::{LANES, product};

/// How the likeness of a template and a part of an image is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Similarity {
    /// The sum of squared differences of the paper, Eq. (6), as `1 − E / Σ (T² + I²)`.
    SquaredDifferences,
    /// Zero-mean normalized correlation: the same under any gain and offset of the light.
    #[default]
    Correlation,
}

/// Where a template fits best.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Column of the image under the template's first.
    pub x: usize,
    /// Row of the image under the template's first.
    pub y: usize,
    /// 1 where they are equal.
    pub score: f64,
}

/// Sums over the part of an image under a template.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Sums {
    image: u64,
    image_squared: u64,
    product: u64,
}

/// Sum of squared differences, Eq. (6), at every place of the template within the image, row by
/// row; as many columns as `image.width() − template.width() + 1`. Empty if it does not fit.
///
/// ```text
/// E(x, y) = Σ (T(x', y') − I(x + x', y + y'))²  =  Σ T² − 2 Σ T I + Σ I²
/// ```
///
/// The sums of `I²` come from an integral image; whole numbers keep the result exact.
pub fn squared_differences(template: &GrayImage, image: &GrayImage) -> Vec<u64> {
    let own = squared_sum(template);
    sums(template, image).iter().map(|s| own + s.image_squared - 2 * s.product).collect()
}

/// Zero-mean normalized correlation at every place, in [−1, 1]; 0 where either has no contrast.
pub fn correlation(template: &GrayImage, image: &GrayImage) -> Vec<f64> {
    let own = template.pixels().iter().map(|&v| u64::from(v)).sum::<u64>();
    let own_squared = squared_sum(template);
    let num = template.pixels().len() as f64;
    let variance = |sum: u64, squared: u64| squared as f64 - (sum as f64).powi(2) / num;
    let own_variance = variance(own, own_squared);
    let score = |s: &Sums| {
        let scale = own_variance * variance(s.image, s.image_squared);
        let covariance = s.product as f64 - own as f64 * s.image as f64 / num;
        // Half a gray level in one pixel is no contrast.
        if scale > 0.25 { covariance / scale.sqrt() } else { 0.0 }
    };
    sums(template, image).iter().map(score).collect()
}

/// The place where `template` fits best, the first of equals; `None` if it does not fit.
pub fn best_place(
    template: &GrayImage,
    image: &GrayImage,
    similarity: Similarity,
) -> Option<Place> {
    let columns = (image.width() + 1).checked_sub(template.width())? as usize;
    let scores = match similarity {
        Similarity::Correlation => correlation(template, image),
        Similarity::SquaredDifferences => {
            let own = squared_sum(template);
            let likeness = |s: &Sums| {
                let squares = own + s.image_squared;
                let differences = squares - 2 * s.product;
                1.0 - differences as f64 / squares.max(1) as f64
            };
            sums(template, image).iter().map(likeness).collect()
        }
    };
    let mut best: Option<Place> = None;
    for (index, &score) in scores.iter().enumerate() {
        if best.is_none_or(|place| score > place.score) {
            best = Some(Place { x: index % columns, y: index / columns, score });
        }
    }
    best
}

fn squared_sum(image: &GrayImage) -> u64 {
    image.pixels().iter().map(|&v| u64::from(v) * u64::from(v)).sum()
}

/// Sums at every place, row by row.
fn sums(template: &GrayImage, image: &GrayImage) -> Vec<Sums> {
    let (tw, th) = (template.width() as usize, template.height() as usize);
    let (width, height) = (image.width() as usize, image.height() as usize);
    if tw == 0 || th == 0 || tw > width || th > height {
        return Vec::new();
    }
    let plain = Integral::new(image, |v| v);
    let squared = Integral::new(image, |v| v * v);
    // Templates are filled up with zeros to whole lanes, images by as much.
    let lanes = tw.next_multiple_of(LANES);
    let stride = width + lanes - tw;
    let (wide_template, wide_image) = (widened(template, lanes), widened(image, stride));
    let level = SimdLevel::detect();
    let mut all = Vec::with_capacity((width - tw + 1) * (height - th + 1));
    for y in 0..=height - th {
        for x in 0..=width - tw {
            let start = y * stride + x;
            let product = product(level, &wide_template, lanes, &wide_image, stride, start);
            let part = [x, y, x + tw, y + th];
            let (image, image_squared) = (plain.sum(part), squared.sum(part));
            all.push(Sums { image, image_squared, product });
        }
    }
    all
}

/// Rows filled up with zeros to `stride`.
fn widened(image: &GrayImage, stride: usize) -> Vec<i16> {
    let mut wide = vec![0; stride * image.height() as usize];
    for (to, y) in wide.chunks_exact_mut(stride).zip(0..) {
        to.iter_mut().zip(image.row(y)).for_each(|(to, &v)| *to = i16::from(v));
    }
    wide
}

/// Sums over rectangles in four reads.
struct Integral {
    stride: usize,
    sums: Vec<u64>,
}

impl Integral {
    fn new(image: &GrayImage, value: impl Fn(u64) -> u64) -> Self {
        let stride = image.width() as usize + 1;
        let mut sums = vec![0; stride * (image.height() as usize + 1)];
        for y in 0..image.height() {
            let mut row_sum = 0;
            for (x, &v) in image.row(y).iter().enumerate() {
                row_sum += value(u64::from(v));
                let above = sums[y as usize * stride + x + 1];
                sums[(y as usize + 1) * stride + x + 1] = above + row_sum;
            }
        }
        Self { stride, sums }
    }

    /// Over columns `x0..x1` and rows `y0..y1`.
    fn sum(&self, [x0, y0, x1, y1]: [usize; 4]) -> u64 {
        let at = |x: usize, y: usize| self.sums[y * self.stride + x];
        at(x1, y1) + at(x0, y0) - at(x0, y1) - at(x1, y0)
    }
}

#[cfg(test)]
mod tests {
    use volery_geometry::Rng;

    use super::*;

    fn noise(width: u32, height: u32, seed: u64) -> GrayImage {
        let mut rng = Rng::new(seed);
        let pixels = (0..width * height).map(|_| rng.bits() as u8).collect();
        GrayImage::new(width, height, pixels).unwrap()
    }

    fn cut(image: &GrayImage, x: u32, y: u32, width: u32, height: u32) -> GrayImage {
        let rows = (y..y + height)
            .flat_map(|row| image.row(row)[x as usize..(x + width) as usize].to_vec());
        GrayImage::new(width, height, rows.collect()).unwrap()
    }

    /// Eq. (6) term by term (P65).
    #[test]
    fn squared_differences_are_those_of_the_paper() {
        let (template, image) = (noise(7, 5, 1), noise(19, 13, 2));
        let fast = squared_differences(&template, &image);
        assert_eq!(fast.len(), 13 * 9);
        for (k, &e) in fast.iter().enumerate() {
            let (x, y) = (k as u32 % 13, k as u32 / 13);
            let mut plain = 0;
            for (yy, xx) in (0..5).flat_map(|yy| (0..7).map(move |xx| (yy, xx))) {
                let t = i64::from(template.row(yy)[xx as usize]);
                let i = i64::from(image.row(y + yy)[(x + xx) as usize]);
                plain += (t - i) * (t - i);
            }
            assert_eq!(e as i64, plain);
        }
    }

    #[test]
    fn correlation_is_that_of_the_textbook() {
        let (template, image) = (noise(6, 6, 3), noise(14, 11, 4));
        let mean = |v: &GrayImage| {
            v.pixels().iter().map(|&p| f64::from(p)).sum::<f64>() / v.pixels().len() as f64
        };
        for (k, score) in correlation(&template, &image).iter().enumerate() {
            let part = cut(&image, k as u32 % 9, k as u32 / 9, 6, 6);
            let (mt, mi) = (mean(&template), mean(&part));
            let pairs = || template.pixels().iter().zip(part.pixels());
            let product: f64 =
                pairs().map(|(&t, &i)| (f64::from(t) - mt) * (f64::from(i) - mi)).sum();
            let squares = |m: f64, v: &GrayImage| -> f64 {
                v.pixels().iter().map(|&p| (f64::from(p) - m).powi(2)).sum()
            };
            let plain = product / (squares(mt, &template) * squares(mi, &part)).sqrt();
            assert!((score - plain).abs() < 1e-9, "{score} {plain}");
        }
    }

    /// Both find a part of an image (P67); only correlation finds it in other light.
    #[test]
    fn a_part_is_found_where_it_was_cut() {
        let image = noise(40, 30, 5);
        let template = cut(&image, 17, 9, 12, 10);
        let dimmed: Vec<u8> = template.pixels().iter().map(|&v| v / 3 + 5).collect();
        let dimmed = GrayImage::new(12, 10, dimmed).unwrap();
        for similarity in [Similarity::SquaredDifferences, Similarity::Correlation] {
            let place = best_place(&template, &image, similarity).unwrap();
            assert_eq!((place.x, place.y, place.score), (17, 9, 1.0));
        }
        let place = best_place(&dimmed, &image, Similarity::Correlation).unwrap();
        assert!((place.x, place.y) == (17, 9) && place.score > 0.99, "{place:?}");
        assert!(squared_differences(&dimmed, &image)[9 * 29 + 17] > 0);
    }

    #[test]
    fn what_does_not_fit_has_no_place() {
        let (small, large) = (noise(4, 4, 6), noise(5, 9, 7));
        assert_eq!(best_place(&large, &small, Similarity::Correlation), None);
        assert!(squared_differences(&large, &small).is_empty());
        let flat = GrayImage::new(4, 4, vec![9; 16]).unwrap();
        assert!(correlation(&flat, &large).iter().all(|&score| score == 0.0));
    }
}
