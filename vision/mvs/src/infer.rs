//! Surfaces without texture, concluded from trusted surfaces around them.

use nalgebra::Vector3;
use volery_scene::{DepthMap, GrayImage};

use crate::planar_prior::{Support, planar_prior};
use crate::plane::Rays;

/// Edge of the cells of which each gives one trusted pixel, pixels.
const CELL: usize = 6;
/// Least cosine between a plane and the normals at the three pixels that it goes through: they
/// are one flat surface.
const FLAT_COS: f32 = 0.9;
/// Pixels from the center of the window on which texture is measured.
const WINDOW: usize = 4;
/// Standard deviation of gray values up to which a window has no texture.
const FLAT_GRAY: f32 = 8.0;
/// Confidence of what was not seen.
const INFERRED_CONFIDENCE: u8 = 20;

/// Gives depth to pixels without texture that lie between three trusted ones of one flat surface,
/// and marks them inferred.
pub(crate) fn infer_flat_surfaces(map: &mut DepthMap, gray: &GrayImage) {
    let (width, height) = (map.width(), map.height());
    let supports = trusted_pixels(map);
    let rays = Rays::new(&map.camera);
    let points: Vec<Support> = supports.iter().map(|&(_, point)| point).collect();
    let is_flat = |corners: [usize; 3], plane: &crate::plane::Plane| {
        corners.into_iter().all(|corner| {
            let (index, Support { u, v, w }) = supports[corner];
            let held = crate::plane::Plane { w, ..*plane };
            rays.is_visible(&held, u, v)
                && rays.normal(&held, u, v).dot(&Vector3::from(map.normals[index])) > FLAT_COS
        })
    };
    let planes = planar_prior(&points, width, height, is_flat);
    let deviation = local_deviation(gray);
    for (index, plane) in planes.into_iter().enumerate() {
        let Some(plane) = plane.filter(|plane| plane.w > 0.0) else { continue };
        if map.depth[index] > 0.0 || deviation[index] > FLAT_GRAY {
            continue;
        }
        let (u, v) = ((index % width) as f32 + 0.5, (index / width) as f32 + 0.5);
        map.depth[index] = 1.0 / plane.w;
        map.normals[index] = rays.normal(&plane, u, v).into();
        map.confidence[index] = INFERRED_CONFIDENCE;
        map.inferred[index] = true;
    }
}

/// The most confident known pixel of every cell.
fn trusted_pixels(map: &DepthMap) -> Vec<(usize, Support)> {
    let (width, height) = (map.width(), map.height());
    let mut trusted = Vec::new();
    for top in (0..height).step_by(CELL) {
        for left in (0..width).step_by(CELL) {
            let rows = top..(top + CELL).min(height);
            let cell = rows.flat_map(|y| (left..(left + CELL).min(width)).map(move |x| (x, y)));
            let known = cell.filter(|(x, y)| map.depth[y * width + x] > 0.0);
            let best = known.max_by_key(|&(x, y)| (map.confidence[y * width + x], y, x));
            if let Some((x, y)) = best {
                let index = y * width + x;
                let (u, v) = (x as f32 + 0.5, y as f32 + 0.5);
                trusted.push((index, Support { u, v, w: 1.0 / map.depth[index] }));
            }
        }
    }
    trusted
}

/// Standard deviation of gray values in a window around every pixel.
fn local_deviation(gray: &GrayImage) -> Vec<f32> {
    let (width, height) = (gray.width() as usize, gray.height() as usize);
    // Sums over all pixels above and left of a corner.
    let mut sums = vec![[0u64; 2]; (width + 1) * (height + 1)];
    for y in 0..height {
        let mut row = [0u64; 2];
        for (x, &value) in gray.row(y as u32).iter().enumerate() {
            let value = u64::from(value);
            row = [row[0] + value, row[1] + value * value];
            let above = sums[y * (width + 1) + x + 1];
            sums[(y + 1) * (width + 1) + x + 1] = [above[0] + row[0], above[1] + row[1]];
        }
    }
    let deviation = |x: usize, y: usize| {
        let (left, right) = (x.saturating_sub(WINDOW), (x + WINDOW + 1).min(width));
        let (top, bottom) = (y.saturating_sub(WINDOW), (y + WINDOW + 1).min(height));
        let at = |x: usize, y: usize, k: usize| sums[y * (width + 1) + x][k];
        let [sum, squares] = [0, 1].map(|k| {
            (at(right, bottom, k) + at(left, top, k) - at(left, bottom, k) - at(right, top, k))
                as f64
        });
        let n = ((right - left) * (bottom - top)) as f64;
        (squares / n - (sum / n) * (sum / n)).max(0.0).sqrt() as f32
    };
    (0..width * height).map(|index| deviation(index % width, index / width)).collect()
}

#[cfg(test)]
mod tests {
    use volery_geometry::{Camera, CameraModel, Isometry3};
    use volery_scene::ImageId;

    use super::*;

    const WIDTH: usize = 80;
    const HEIGHT: usize = 60;

    /// A map of surfaces given as `(w, normal)` per pixel, unknown in the middle.
    fn map_with_hole(surface: impl Fn(f32, f32) -> (f32, Vector3<f32>)) -> DepthMap {
        let size = (WIDTH as u32, HEIGHT as u32);
        let camera = Camera::from_focal(CameraModel::Pinhole, size.0, size.1, 80.0).unwrap();
        let mut map = DepthMap::empty(ImageId(0), camera, Isometry3::identity());
        for index in (0..WIDTH * HEIGHT).filter(|&index| !in_hole(index)) {
            let (w, normal) = surface((index % WIDTH) as f32 + 0.5, (index / WIDTH) as f32 + 0.5);
            map.depth[index] = 1.0 / w;
            map.normals[index] = normal.normalize().into();
            map.confidence[index] = 200;
        }
        map
    }

    fn in_hole(index: usize) -> bool {
        let (x, y) = (index % WIDTH, index / WIDTH);
        (24..56).contains(&x) && (15..45).contains(&y)
    }

    fn gray(value: impl Fn(usize) -> u8) -> GrayImage {
        let pixels = (0..WIDTH * HEIGHT).map(value).collect();
        GrayImage::new(WIDTH as u32, HEIGHT as u32, pixels).unwrap()
    }

    /// The wall x + z = 2 seen askew: w = (x/z + 1) / 2.
    fn wall(u: f32, _v: f32) -> (f32, Vector3<f32>) {
        (((u - 40.0) / 80.0 + 1.0) / 2.0, Vector3::new(-1.0, 0.0, -1.0))
    }

    #[test]
    fn a_blank_wall_is_completed_and_says_so() {
        let mut map = map_with_hole(wall);
        infer_flat_surfaces(&mut map, &gray(|_| 100));
        for index in (0..WIDTH * HEIGHT).filter(|&index| in_hole(index)) {
            let (w, normal) = wall((index % WIDTH) as f32 + 0.5, 0.0);
            assert!((map.depth[index] * w - 1.0).abs() < 1e-4);
            assert!(Vector3::from(map.normals[index]).dot(&normal.normalize()) > 0.999);
            assert!(map.inferred[index] && map.confidence[index] < 50);
        }
        assert!((0..WIDTH * HEIGHT).all(|index| map.inferred[index] == in_hole(index)));
    }

    /// Something with texture that was not found is not a part of the wall.
    #[test]
    fn what_has_texture_is_not_inferred() {
        let mut map = map_with_hole(wall);
        let checkered =
            |index: usize| if in_hole(index) { 100 + (index % 3) as u8 * 50 } else { 100 };
        infer_flat_surfaces(&mut map, &gray(checkered));
        assert!(!map.inferred[30 * WIDTH + 40]);
    }

    /// Between a near and a far surface there may be anything.
    #[test]
    fn nothing_is_put_between_surfaces_of_different_depth() {
        let mut map =
            map_with_hole(|u, _| (if u < 40.0 { 1.0 } else { 0.4 }, Vector3::new(0.0, 0.0, -1.0)));
        infer_flat_surfaces(&mut map, &gray(|_| 100));
        for index in (0..WIDTH * HEIGHT).filter(|&index| map.inferred[index]) {
            let w = 1.0 / map.depth[index];
            assert!((w - 1.0).abs() < 1e-3 || (w - 0.4).abs() < 1e-3, "{w}");
        }
    }
}
