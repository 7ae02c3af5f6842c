//! Planes through points that are trusted.

use crate::delaunay::{MAX_COORDINATE, delaunay};
use crate::plane::Plane;

/// Grid cells per pixel for the exact arithmetic of the triangulation.
const SUBPIXEL: f32 = 16.0;

/// A pixel position with its inverse depth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Support {
    pub(crate) u: f32,
    pub(crate) v: f32,
    pub(crate) w: f32,
}

/// The planes through those triangles of a Delaunay triangulation of `points` that are `wanted`,
/// row by row; `None` elsewhere. `wanted` is given the positions of the corners in `points` and the
/// plane as the first of them holds it.
///
/// Source: Xu and Tao, "Planar Prior Assisted PatchMatch Multi-View Stereo", AAAI 2020, section 4.
pub(crate) fn planar_prior(
    points: &[Support],
    width: usize,
    height: usize,
    wanted: impl Fn([usize; 3], &Plane) -> bool,
) -> Vec<Option<Plane>> {
    let max = MAX_COORDINATE as f32;
    let on_grid = |v: f32| (v * SUBPIXEL).round().clamp(-max, max) as i32;
    let grid: Vec<[i32; 2]> = points.iter().map(|p| [on_grid(p.u), on_grid(p.v)]).collect();
    let mut planes = vec![None; width * height];
    for triangle in delaunay(&grid) {
        let [a, b, c] = triangle.map(|v| points[v as usize]);
        let Some((slope_u, slope_v)) = slopes(&a, &b, &c) else { continue };
        let at_a = Plane { w: a.w, slope_u, slope_v };
        if !wanted(triangle.map(|v| v as usize), &at_a) {
            continue;
        }
        let rows = span([a.v, b.v, c.v], height);
        let columns = span([a.u, b.u, c.u], width);
        for y in rows {
            for x in columns.clone() {
                let (u, v) = (x as f32 + 0.5, y as f32 + 0.5);
                let side = |p: &Support, q: &Support| {
                    (q.u - p.u) * (v - p.v) - (q.v - p.v) * (u - p.u) >= 0.0
                };
                if side(&a, &b) && side(&b, &c) && side(&c, &a) {
                    planes[y * width + x] = Some(at_a.moved(u - a.u, v - a.v));
                }
            }
        }
    }
    planes
}

/// Pixels whose centers may lie between the least and the greatest value.
fn span(values: [f32; 3], size: usize) -> std::ops::Range<usize> {
    let low = values.into_iter().fold(f32::INFINITY, f32::min);
    let high = values.into_iter().fold(f32::NEG_INFINITY, f32::max);
    (low - 0.5).max(0.0) as usize..((high + 0.5).max(0.0) as usize).min(size)
}

/// Slopes of the linear function with the inverse depths of three points.
fn slopes(a: &Support, b: &Support, c: &Support) -> Option<(f32, f32)> {
    let [ub, vb, wb] = [b.u - a.u, b.v - a.v, b.w - a.w];
    let [uc, vc, wc] = [c.u - a.u, c.v - a.v, c.w - a.w];
    let determinant = ub * vc - uc * vb;
    let slopes = ((wb * vc - wc * vb) / determinant, (ub * wc - uc * wb) / determinant);
    (determinant.abs() > 1e-3).then_some(slopes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_plane_is_found_everywhere_inside() {
        let w = |u: f32, v: f32| 0.4 + 0.002 * u - 0.001 * v;
        let spots = [[2.0, 3.0], [60.0, 1.0], [30.0, 20.0], [5.0, 44.0], [61.0, 46.0], [31.0, 9.5]];
        let points = spots.map(|[u, v]| Support { u, v, w: w(u, v) });
        let planes = planar_prior(&points, 64, 48, |_, _| true);
        let inside = planes[24 * 64 + 32].unwrap();
        assert!((inside.w - w(32.5, 24.5)).abs() < 1e-5);
        assert!((inside.slope_u - 0.002).abs() < 1e-6 && (inside.slope_v + 0.001).abs() < 1e-6);
        assert_eq!(planes[0], None);
        let covered = planes.iter().flatten().count();
        assert!((1800..2700).contains(&covered), "{covered}");
    }
}
