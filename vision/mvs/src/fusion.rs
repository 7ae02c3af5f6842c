//! Depth maps become one cloud of oriented points.

use nalgebra::Vector3;
use rayon::prelude::*;
use volery_scene::{DepthMap, OrientedPoint, PointCloud};

use crate::related::{Related, SAME_DEPTH, Seen, SharedSurface, footprint, related};

/// Other maps that a point is averaged over.
const MAX_RELATED: usize = 16;

/// Fuses filtered maps: what several maps see becomes one point at the mean of their depths, on the
/// ray of the map that sees it largest. `color` gives the sRGB of a pixel of a map.
pub fn fuse_depth_maps(
    maps: &[DepthMap],
    color: &(dyn Fn(&DepthMap, usize) -> [u8; 3] + Sync),
) -> PointCloud {
    let points =
        maps.par_iter().flat_map_iter(|map| fused(map, maps.iter(), &|index| color(map, index)));
    PointCloud { points: points.collect() }
}

/// The points of `map` that none of the `others` sees better.
pub(crate) fn fused<'a>(
    map: &DepthMap,
    others: impl Iterator<Item = &'a DepthMap>,
    color: &dyn Fn(usize) -> [u8; 3],
) -> Vec<OrientedPoint> {
    let related = related(map, others, MAX_RELATED);
    let known = (0..map.depth.len()).filter(|&index| map.depth[index] > 0.0);
    let points = known.filter_map(|index| {
        let point = fuse_pixel(map, index, &related)?;
        Some(OrientedPoint { color: color(index), ..point })
    });
    points.collect()
}

/// The point of a pixel, unless another map sees it larger.
fn fuse_pixel(map: &DepthMap, index: usize, related: &[Related]) -> Option<OrientedPoint> {
    // What was seen speaks before what was inferred, then the larger view, then the first.
    let rank = |map: &DepthMap, index: usize| {
        (map.inferred[index], footprint(map, map.depth[index]), map.image)
    };
    let own_rank = rank(map, index);
    let seen = Seen::of(map, index);
    let normal = Vector3::from(map.normals[index]);
    let mut surface = SharedSurface::new(map, index, &normal);
    let mut confidence = map.confidence[index];
    for other in related {
        let Some(landing) = other.landing(&seen) else { continue };
        let Some(witness) = other.witness(&normal, &landing, SAME_DEPTH) else { continue };
        if rank(other.map, landing.pixel) < own_rank {
            return None;
        }
        if other.map.inferred[landing.pixel] == map.inferred[index] {
            surface.hear(&witness, 1.0);
            confidence = confidence.max(other.map.confidence[landing.pixel]);
        }
    }
    let on_surface = map.point_in_cam(index)? * f64::from(surface.depth());
    let rotation = map.cam_from_world.rotation.inverse();
    Some(OrientedPoint {
        position: map.cam_from_world.inverse_transform_point(&on_surface).cast(),
        normal: rotation.cast::<f32>() * surface.normal(),
        color: [0; 3],
        confidence,
        inferred: map.inferred[index],
    })
}

#[cfg(test)]
mod tests {
    use volery_geometry::{Camera, CameraModel, Isometry3};
    use volery_scene::{ImageId, OctNormal};

    use super::*;

    /// A view of the plane z = 2 from `(x, 0, z)` with depths off by the factor `1 + error`.
    fn view(index: u32, x: f64, z: f64, error: f32) -> DepthMap {
        let camera = Camera::from_focal(CameraModel::Pinhole, 40, 30, 40.0).unwrap();
        let mut map = DepthMap::empty(ImageId(index), camera, Isometry3::translation(-x, 0.0, -z));
        map.depth.fill((2.0 - z as f32) * (1.0 + error));
        map.normals.fill(OctNormal::from(Vector3::new(0.0, 0.0, -1.0)));
        map.confidence.fill(100);
        map
    }

    fn fused(maps: &[DepthMap]) -> PointCloud {
        fuse_depth_maps(maps, &|map, _| [map.image.0 as u8; 3])
    }

    /// What the near view shows comes from it alone; the far view adds what only it shows.
    #[test]
    fn every_surface_is_there_once_at_the_best_resolution() {
        let (near, far) = (view(0, 0.0, 0.5, 0.0), view(1, 0.0, -0.5, 0.0));
        let cloud = fused(&[near, far]);
        let from = |image: u8| cloud.points.iter().filter(move |p| p.color[0] == image);
        assert_eq!(from(0).count(), 1200);
        // The near view covers 0.36 of the far one.
        let rest = from(1).count() as f64 / 1200.0;
        assert!((rest - 0.64).abs() < 0.05, "{rest}");
        assert!(from(1).all(|p| p.position.x.abs() > 0.7 || p.position.y.abs() > 0.5));
    }

    /// The mean of two maps that are off to either side is nearer to the truth.
    #[test]
    fn positions_are_averaged() {
        let cloud = fused(&[view(0, 0.0, 0.0, 0.003), view(1, 0.01, 0.0, -0.003)]);
        let good = cloud.points.iter().filter(|p| (p.position.z - 2.0).abs() < 1e-4).count();
        assert!(good > 1000, "{good} of {}", cloud.points.len());
    }

    #[test]
    fn what_was_seen_speaks_before_what_was_inferred() {
        let mut near = view(0, 0.0, 0.5, 0.0);
        near.inferred.fill(true);
        let cloud = fused(&[near, view(1, 0.0, 0.0, 0.0)]);
        assert_eq!(cloud.points.iter().filter(|p| !p.inferred).count(), 1200);
        assert_eq!(cloud.points.iter().filter(|p| p.inferred).count(), 0);
        assert!(fused(&[]).points.is_empty());
    }
}
