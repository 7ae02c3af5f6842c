//! What no other image confirms, or what another sees through, is forgotten.

use nalgebra::Vector3;
use rayon::prelude::*;
use volery_scene::DepthMap;

use crate::related::{Related, SAME_DEPTH, Seen, SharedSurface, related};

/// Other maps that are asked.
const MAX_RELATED: usize = 16;
/// Distance within which a pixel comes back to itself through the other map, pixels.
const SAME_PIXEL_PX: f32 = 2.0;
/// Relative distance by which a point must lie in front of a surface that is seen behind it.
const IN_FRONT: f32 = 0.03;
/// Relative difference of depth within which another map confirms a pixel by half, as both are noisy:
/// two such maps are as good as one within [`SAME_DEPTH`].
const HALF_CONFIRMED: f32 = 2.0 * SAME_DEPTH;
/// Confidence below which a pixel is not worth asking for, and its map no witness.
const MIN_CONFIDENCE: u8 = 20;
/// Pixels of a connected piece of surface that is too small to be one.
const MIN_PIECE: usize = 30;
/// Relative difference of depth within which neighboring pixels are connected.
const CONNECTED: f32 = 0.02;

/// Forgets the pixels that no other map confirms, those that twice as many maps see through as
/// confirm (P43), and small pieces. What is kept becomes the mean of the maps that confirm it.
pub fn filter_depth_maps(maps: &[DepthMap]) -> Vec<DepthMap> {
    maps.par_iter().map(|map| confirmed(map, maps.iter())).collect()
}

/// The pixels of `map` that [`filter_depth_maps`] keeps, `others` being asked.
pub(crate) fn confirmed<'a>(
    map: &DepthMap,
    others: impl Iterator<Item = &'a DepthMap>,
) -> DepthMap {
    let related = related(map, others, MAX_RELATED);
    let mut kept = map.clone();
    for index in 0..map.depth.len() {
        match confirmed_surface(map, index, &related) {
            Some(surface) => {
                kept.depth[index] *= surface.depth();
                kept.normals[index] = surface.normal().into();
            }
            None => kept.clear(index),
        }
    }
    remove_small_pieces(&mut kept);
    kept
}

/// `map` without the inferred pixels that another one sees through.
pub(crate) fn not_seen_through<'a>(
    map: &DepthMap,
    others: impl Iterator<Item = &'a DepthMap>,
) -> DepthMap {
    let related = related(map, others, MAX_RELATED);
    let mut kept = map.clone();
    for index in (0..map.depth.len()).filter(|&index| map.inferred[index]) {
        let seen = Seen::of(map, index);
        let mut landings = related.iter().filter_map(|other| {
            let landing = other.landing(&seen)?;
            (!other.map.inferred[landing.pixel]).then_some(landing)
        });
        if landings.any(|l| l.depth < l.known * (1.0 - IN_FRONT)) {
            kept.clear(index);
        }
    }
    kept
}

/// The surface of a pixel as it and those that confirm it have it, if they are enough.
fn confirmed_surface(map: &DepthMap, index: usize, related: &[Related]) -> Option<SharedSurface> {
    if map.depth[index] <= 0.0 || map.confidence[index] < MIN_CONFIDENCE {
        return None;
    }
    let (mut halves, mut seen_through) = (0, 0);
    let seen = Seen::of(map, index);
    let normal = Vector3::from(map.normals[index]);
    let mut surface = SharedSurface::new(map, index, &normal);
    for other in related {
        let Some(landing) = other.landing(&seen) else { continue };
        if other.map.confidence[landing.pixel] < MIN_CONFIDENCE {
            continue;
        }
        let witness = other.witness(&normal, &landing, HALF_CONFIRMED);
        if let Some(witness) = witness
            && other.comes_back(&seen, &landing, SAME_PIXEL_PX)
        {
            let said = if witness.is_same_depth { 2 } else { 1 };
            halves += said;
            surface.hear(&witness, 0.5 * said as f32);
        } else if landing.depth < landing.known * (1.0 - IN_FRONT) {
            seen_through += 1;
        }
    }
    (halves >= 2 && halves > seen_through).then_some(surface)
}

/// Forgets connected pieces of fewer than [`MIN_PIECE`] pixels.
fn remove_small_pieces(map: &mut DepthMap) {
    let (width, height) = (map.width(), map.height());
    let mut visited = vec![false; map.depth.len()];
    let mut piece = Vec::new();
    for start in 0..map.depth.len() {
        if visited[start] || map.depth[start] <= 0.0 {
            continue;
        }
        visited[start] = true;
        piece.clear();
        piece.push(start);
        let mut next = 0;
        while let Some(&index) = piece.get(next) {
            next += 1;
            let (x, y) = (index % width, index / width);
            let around = [
                (x > 0).then(|| index - 1),
                (x + 1 < width).then_some(index + 1),
                (y > 0).then(|| index - width),
                (y + 1 < height).then_some(index + width),
            ];
            for neighbor in around.into_iter().flatten() {
                let (a, b) = (map.depth[index], map.depth[neighbor]);
                if !visited[neighbor] && b > 0.0 && (a - b).abs() < CONNECTED * a.min(b) {
                    visited[neighbor] = true;
                    piece.push(neighbor);
                }
            }
        }
        if piece.len() < MIN_PIECE {
            for &index in &piece {
                map.clear(index);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use volery_geometry::{Camera, CameraModel, Isometry3};
    use volery_scene::{ImageId, OctNormal};

    use super::*;

    const WIDTH: u32 = 40;
    const HEIGHT: u32 = 30;

    /// Views of the plane z = 2 from places along x.
    fn views(num: u32) -> Vec<DepthMap> {
        let camera = Camera::from_focal(CameraModel::Pinhole, WIDTH, HEIGHT, 40.0).unwrap();
        let view = |index: u32| {
            let cam_from_world = Isometry3::translation(-0.1 * f64::from(index), 0.0, 0.0);
            let mut map = DepthMap::empty(ImageId(index), camera, cam_from_world);
            map.depth.fill(2.0);
            map.normals.fill(OctNormal::from(Vector3::new(0.0, 0.0, -1.0)));
            map.confidence.fill(200);
            map
        };
        (0..num).map(view).collect()
    }

    /// Pixels of a square in the middle, `size` wide.
    fn middle(size: usize) -> impl Iterator<Item = usize> {
        let (left, top) = ((WIDTH as usize - size) / 2, (HEIGHT as usize - size) / 2);
        (0..size * size).map(move |k| (top + k / size) * WIDTH as usize + left + k % size)
    }

    #[test]
    fn what_all_agree_on_is_kept() {
        let kept = filter_depth_maps(&views(4));
        for map in &kept {
            // A view that is moved by two pixels sees all but two columns.
            assert!(map.num_known() >= 36 * HEIGHT as usize);
        }
    }

    /// Something that one map alone puts before the wall, and a depth that no other map has.
    #[test]
    fn what_nobody_confirms_is_forgotten() {
        for wrong in [1.2, 2.3] {
            let mut maps = views(4);
            middle(12).for_each(|index| maps[1].depth[index] = wrong);
            let kept = filter_depth_maps(&maps);
            assert!(middle(12).all(|index| kept[1].depth[index] == 0.0));
            assert!(kept[1].depth[0] == 2.0);
        }
    }

    /// A map that is off by 1.5 % needs two others; off by 3 % it stands alone.
    #[test]
    fn two_that_nearly_agree_confirm_as_one_that_agrees() {
        let num_kept = |num_views: u32, depth: f32| {
            let mut maps = views(num_views);
            maps[0].depth.fill(depth);
            filter_depth_maps(&maps)[0].num_known()
        };
        assert!(num_kept(2, 2.0) > 1000 && num_kept(3, 2.03) > 1000);
        assert_eq!((num_kept(2, 2.03), num_kept(3, 2.06)), (0, 0));
    }

    /// Two maps agree on a surface that four others look through (P43).
    #[test]
    fn what_most_see_through_is_forgotten() {
        let mut maps = views(6);
        for map in &mut maps[..2] {
            middle(18).for_each(|index| map.depth[index] = 1.6);
        }
        let kept = filter_depth_maps(&maps);
        assert!(middle(10).all(|index| kept[0].depth[index] == 0.0));
        assert!(middle(4).all(|index| kept[4].depth[index] == 2.0));
        // Without those that see through they are believed: it is the votes that decide.
        let believed = filter_depth_maps(&maps[..2]);
        assert!(middle(10).all(|index| (believed[0].depth[index] - 1.6).abs() < 1e-5));
    }

    #[test]
    fn inferred_surfaces_that_others_see_through_are_forgotten() {
        let mut maps = views(3);
        for index in middle(10) {
            maps[0].depth[index] = 1.5;
            maps[0].inferred[index] = true;
        }
        let kept = not_seen_through(&maps[0], maps.iter());
        assert!(middle(10).all(|index| kept.depth[index] == 0.0));
        assert!(kept.depth[0] == 2.0);
    }

    /// Errors of single maps are averaged; without any, a slanted wall stays where it is, though
    /// its points fall between the pixels of the others.
    #[test]
    fn what_is_kept_is_the_mean() {
        let mut maps = views(6);
        for map in &mut maps {
            // 0.5 z + 0.1 x + 0.05 y = 1 as the first sees it; the others are moved along x.
            let distance = 1.0 + 0.1 * map.cam_from_world.translation.x;
            map.depth.fill(1.0);
            for index in 0..map.depth.len() {
                let ray = map.point_in_cam(index).unwrap();
                map.depth[index] = (distance / (0.5 + 0.1 * ray.x + 0.05 * ray.y)) as f32;
                map.normals[index] =
                    OctNormal::from(-Vector3::new(0.1, 0.05, 0.5).normalize().cast::<f32>());
            }
        }
        let error = |kept: &DepthMap, truth: &DepthMap| {
            let of = |index: usize| f64::from(kept.depth[index] / truth.depth[index] - 1.0);
            (middle(20).map(|index| of(index).powi(2)).sum::<f64>() / 400.0).sqrt()
        };
        let exact = filter_depth_maps(&maps);
        assert!(error(&exact[2], &maps[2]) < 1e-4);
        let mut noisy = maps.clone();
        let mut random = 1_u32;
        for depth in noisy.iter_mut().flat_map(|map| &mut map.depth) {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            *depth *= 1.0 + 0.004 * ((random >> 8) as f32 / (1 << 24) as f32 - 0.5);
        }
        let kept = filter_depth_maps(&noisy);
        assert!(error(&kept[2], &maps[2]) < 0.55 * error(&noisy[2], &maps[2]));
    }

    #[test]
    fn specks_are_no_surface() {
        let mut map = views(1).remove(0);
        middle(5).for_each(|index| map.depth[index] = 1.0);
        middle(3).for_each(|index| map.clear(index));
        remove_small_pieces(&mut map);
        assert!(middle(5).all(|index| map.depth[index] == 0.0));
        assert_eq!(map.num_known(), (WIDTH * HEIGHT) as usize - 25);
    }
}
