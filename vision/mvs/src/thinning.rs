//! One point per cell of a grid.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;
use volery_scene::{OrientedPoint, PointCloud};

/// Bits of a cell's number along an axis.
const AXIS_BITS: u32 = 21;

/// The means of the points in each cubic cell of side `cell`. A cell in which anything was seen
/// takes no notice of what was inferred.
///
/// Cells beyond two million along an axis, counted from the lowest corner, are taken as one. A
/// `cell` that is not positive leaves the cloud as it is.
pub fn thin_cloud(cloud: &PointCloud, cell: f32) -> PointCloud {
    if !(cell > 0.0 && cell.is_finite()) {
        return cloud.clone();
    }
    let points = &cloud.points;
    let low = points.iter().fold(Point3::from([f32::INFINITY; 3]), |low, p| low.inf(&p.position));
    let key_of = |point: &OrientedPoint| {
        let at = (point.position - low) / cell;
        let [x, y, z] = [at.x, at.y, at.z].map(|v| (v as u64).min((1 << AXIS_BITS) - 1));
        ((x << AXIS_BITS) | y) << AXIS_BITS | z
    };
    let mut order: Vec<(u64, u32)> =
        points.par_iter().enumerate().map(|(i, point)| (key_of(point), i as u32)).collect();
    // By index within a cell: sums do not depend on the number of threads.
    order.par_sort_unstable();
    let groups: Vec<&[(u64, u32)]> = order.chunk_by(|a, b| a.0 == b.0).collect();
    let mean = |group: &&[(u64, u32)]| mean(group.iter().map(|&(_, i)| &points[i as usize]));
    PointCloud { points: groups.par_iter().filter_map(mean).collect() }
}

/// `None` of no points.
fn mean<'a>(points: impl Iterator<Item = &'a OrientedPoint> + Clone) -> Option<OrientedPoint> {
    let is_inferred = points.clone().all(|point| point.inferred);
    let of_kind = points.filter(|point| point.inferred == is_inferred);
    let first = of_kind.clone().next()?;
    let mut n = 0.0;
    let (mut offset, mut normal) = (Vector3::zeros(), Vector3::zeros());
    let (mut color, mut confidence) = ([0_u32; 3], 0);
    for point in of_kind {
        n += 1.0;
        offset += point.position - first.position;
        normal += point.normal;
        color.iter_mut().zip(point.color).for_each(|(sum, value)| *sum += u32::from(value));
        confidence = confidence.max(point.confidence);
    }
    Some(OrientedPoint {
        position: first.position + offset / n,
        // Opposite sides of a thin sheet have no mean.
        normal: normal.try_normalize(0.1 * n).unwrap_or(first.normal),
        color: color.map(|sum| (sum as f32 / n).round() as u8),
        confidence,
        inferred: is_inferred,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x: f32, inferred: bool) -> OrientedPoint {
        OrientedPoint {
            position: Point3::new(x, 2.0, -1.0),
            normal: Vector3::new(0.0, 0.6, 0.8),
            color: [(10.0 * x) as u8; 3],
            confidence: (100.0 * x) as u8,
            inferred,
        }
    }

    fn cloud(points: &[OrientedPoint]) -> PointCloud {
        PointCloud { points: points.to_vec() }
    }

    #[test]
    fn a_cell_holds_the_mean_of_its_points() {
        let thinned = thin_cloud(&cloud(&[point(0.0, false), point(1.0, false)]), 1.5);
        let [mean] = thinned.points[..] else { panic!("{thinned:?}") };
        assert_eq!(mean.position, Point3::new(0.5, 2.0, -1.0));
        assert!((mean.normal.norm() - 1.0).abs() < 1e-6);
        assert_eq!((mean.color, mean.confidence, mean.inferred), ([5; 3], 100, false));
    }

    #[test]
    fn points_farther_apart_than_a_cell_stay() {
        let far = cloud(&[point(0.0, false), point(2.0, false)]);
        assert_eq!(thin_cloud(&far, 1.5), far);
        assert_eq!(thin_cloud(&far, 0.0), far);
        assert_eq!(thin_cloud(&PointCloud::default(), 1.0), PointCloud::default());
    }

    #[test]
    fn what_was_seen_does_not_mix_with_what_was_inferred() {
        let mixed = cloud(&[point(0.0, true), point(1.0, false)]);
        assert_eq!(thin_cloud(&mixed, 1.5), cloud(&[point(1.0, false)]));
        let inferred = thin_cloud(&cloud(&[point(0.0, true), point(1.0, true)]), 1.5);
        assert!(inferred.points.len() == 1 && inferred.points[0].inferred);
    }

    /// Both sides of a sheet in one cell: some unit normal, never NaN.
    #[test]
    fn opposite_normals_leave_a_normal() {
        let mut back = point(0.0, false);
        back.normal = -back.normal;
        let thinned = thin_cloud(&cloud(&[point(0.0, false), back]), 1.0);
        assert!((thinned.points[0].normal.norm() - 1.0).abs() < 1e-6);
    }
}
