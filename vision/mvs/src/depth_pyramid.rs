//! The nearest depth in any rectangle of a depth map.

use volery_scene::DepthMap;

/// Texels along each side of a rectangle that are looked at, at most one more.
const MAX_TEXELS: f64 = 4.0;

/// A depth map in halving sizes, each texel with what lies under it.
#[derive(Debug, Clone)]
pub(crate) struct DepthPyramid {
    width: usize,
    height: usize,
    levels: Vec<Level>,
}

#[derive(Debug, Clone)]
struct Level {
    width: usize,
    height: usize,
    texels: Vec<Texel>,
}

#[derive(Debug, Clone, Copy)]
struct Texel {
    nearest: f32,
    num_known: u32,
    num_pixels: u32,
}

/// What lies in a rectangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Around {
    /// Least depth of all pixels with a depth, infinite if there is none.
    pub(crate) nearest: f32,
    /// Part of the pixels with a measured depth.
    pub(crate) known: f64,
}

const EMPTY: Texel = Texel { nearest: f32::INFINITY, num_known: 0, num_pixels: 0 };

impl Texel {
    fn with(self, other: Self) -> Self {
        Self {
            nearest: self.nearest.min(other.nearest),
            num_known: self.num_known + other.num_known,
            num_pixels: self.num_pixels + other.num_pixels,
        }
    }
}

impl DepthPyramid {
    pub(crate) fn new(map: &DepthMap) -> Self {
        let (width, height) = (map.width(), map.height());
        let pixels = map.depth.iter().zip(&map.inferred);
        let texels = pixels.map(|(&depth, &inferred)| Texel {
            nearest: if depth > 0.0 { depth } else { f32::INFINITY },
            num_known: u32::from(depth > 0.0 && !inferred),
            num_pixels: 1,
        });
        let mut levels = vec![Level { width, height, texels: texels.collect() }];
        while let Some(next) = levels.last().and_then(Level::half) {
            levels.push(next);
        }
        Self { width, height, levels }
    }

    /// The greatest depth of the map.
    pub(crate) fn max_depth(&self) -> Option<f32> {
        let known = self.levels[0].texels.iter().filter(|texel| texel.num_known > 0);
        known.map(|texel| texel.nearest).reduce(f32::max)
    }

    /// What lies in the rectangle, perhaps in a little more; `None` if it is not all in the image.
    pub(crate) fn around(&self, u: [f64; 2], v: [f64; 2]) -> Option<Around> {
        let inside = u[0] >= 0.0
            && v[0] >= 0.0
            && u[1] < self.width as f64
            && v[1] < self.height as f64
            && u[0] <= u[1]
            && v[0] <= v[1];
        if !inside {
            return None;
        }
        let side = (u[1] - u[0]).max(v[1] - v[0]);
        let mut index = 0;
        while side > MAX_TEXELS * (1_usize << index) as f64 && index + 1 < self.levels.len() {
            index += 1;
        }
        let level = &self.levels[index];
        let texels = |at: f64| at as usize >> index;
        let mut sum = EMPTY;
        for y in texels(v[0])..=texels(v[1]) {
            let row = &level.texels[y * level.width..][..level.width];
            for texel in &row[texels(u[0])..=texels(u[1])] {
                sum = sum.with(*texel);
            }
        }
        let known = f64::from(sum.num_known) / f64::from(sum.num_pixels);
        Some(Around { nearest: sum.nearest, known })
    }
}

impl Level {
    fn half(&self) -> Option<Self> {
        if self.width.max(self.height) <= 1 {
            return None;
        }
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut texels = vec![EMPTY; width * height];
        for (y, row) in self.texels.chunks_exact(self.width).enumerate() {
            for (x, texel) in row.iter().enumerate() {
                let half = &mut texels[y / 2 * width + x / 2];
                *half = half.with(*texel);
            }
        }
        Some(Self { width, height, texels })
    }
}

#[cfg(test)]
mod tests {
    use volery_geometry::{Camera, CameraModel, Isometry3, Rng};
    use volery_scene::ImageId;

    use super::*;

    /// Against a look at every pixel: never farther than the truth, and all of it if it is small.
    #[test]
    fn the_nearest_of_a_rectangle_is_in_it() {
        let camera = Camera::from_focal(CameraModel::Pinhole, 37, 23, 30.0).unwrap();
        let mut map = DepthMap::empty(ImageId(0), camera, Isometry3::identity());
        let mut rng = Rng::new(3);
        for depth in &mut map.depth {
            *depth = if rng.uniform() < 0.3 { 0.0 } else { rng.range(1.0, 5.0) as f32 };
        }
        let pyramid = DepthPyramid::new(&map);
        for _ in 0..500 {
            let [u, v] = [37.0, 23.0].map(|side| {
                let ends = [rng.range(0.0, side), rng.range(0.0, side)];
                [ends[0].min(ends[1]), ends[0].max(ends[1])]
            });
            let around = pyramid.around(u, v).unwrap();
            let rows = v[0] as usize..=v[1] as usize;
            let inside =
                rows.flat_map(|y| (u[0] as usize..=u[1] as usize).map(move |x| y * 37 + x));
            let depths: Vec<f32> = inside.map(|index| map.depth[index]).collect();
            let known = depths.iter().copied().filter(|depth| *depth > 0.0);
            let nearest = known.clone().fold(f32::INFINITY, f32::min);
            assert!(around.nearest <= nearest);
            if (u[1] - u[0]).max(v[1] - v[0]) < MAX_TEXELS {
                assert_eq!(around.nearest, nearest);
                assert_eq!(around.known, known.count() as f64 / depths.len() as f64);
            }
        }
        assert_eq!(pyramid.around([-0.1, 3.0], [1.0, 2.0]), None);
        assert_eq!(pyramid.around([1.0, 3.0], [1.0, 23.0]), None);
        assert_eq!(pyramid.around([1.0, f64::NAN], [1.0, 2.0]), None);
    }
}
