//! Which space a zone has seen to be free.

use nalgebra::{Point3, Vector3};

use crate::surfels::Surfel;

/// Viewpoints that are kept, those farthest from each other.
const MAX_VIEWS: usize = 24;
/// Bins along the edge of a face of the cube of directions: two degrees each.
const BINS: usize = 45;

/// From a few viewpoints, how far one sees in each direction.
#[derive(Debug, Clone)]
pub(crate) struct SeenSpace {
    views: Vec<View>,
}

#[derive(Debug, Clone)]
struct View {
    at: Point3<f64>,
    /// Nearest surface per bin; infinite where none is.
    nearest: Vec<f32>,
    /// Nearest surface in the bin and those around it.
    around: Vec<f32>,
}

impl SeenSpace {
    pub(crate) fn new(pieces: &[Surfel], viewpoints: &[Point3<f64>]) -> Self {
        let views = far_apart(viewpoints).into_iter().map(|at| View::new(at, pieces)).collect();
        Self { views }
    }

    /// Whether some viewpoint saw a surface at least `margin` behind `point` and nothing near its
    /// line of sight before that.
    pub(crate) fn is_seen_through(&self, point: &Point3<f64>, margin: f64) -> bool {
        self.views.iter().any(|view| {
            let ray = point - view.at;
            let bin = bin(&ray);
            let least = ray.norm() + margin;
            view.nearest[bin].is_finite() && f64::from(view.around[bin]) > least
        })
    }
}

impl View {
    fn new(at: Point3<f64>, pieces: &[Surfel]) -> Self {
        let mut nearest = vec![f32::INFINITY; 6 * BINS * BINS];
        for piece in pieces {
            let ray = piece.position - at;
            let range = &mut nearest[bin(&ray)];
            *range = range.min(ray.norm() as f32);
        }
        let around = (0..nearest.len()).map(|bin| least_around(&nearest, bin)).collect();
        Self { at, nearest, around }
    }
}

/// The bin of a direction: face of the cube, row, column.
fn bin(ray: &Vector3<f64>) -> usize {
    let axis = ray.iamax();
    let face = 2 * axis + usize::from(ray[axis] < 0.0);
    let place = |v: f64| {
        // Equal angles, not equal lengths on the face; a ray of no length falls anywhere.
        let s = (v / ray[axis].abs()).atan() / std::f64::consts::FRAC_PI_2 + 0.5;
        ((s * BINS as f64) as usize).min(BINS - 1)
    };
    (face * BINS + place(ray[(axis + 1) % 3])) * BINS + place(ray[(axis + 2) % 3])
}

fn least_around(nearest: &[f32], bin: usize) -> f32 {
    let (column, row, face) = (bin % BINS, bin / BINS % BINS, bin / BINS / BINS);
    let mut least = f32::INFINITY;
    for r in row.saturating_sub(1)..=(row + 1).min(BINS - 1) {
        for c in column.saturating_sub(1)..=(column + 1).min(BINS - 1) {
            least = least.min(nearest[(face * BINS + r) * BINS + c]);
        }
    }
    least
}

/// Farthest-point sampling from the first.
fn far_apart(viewpoints: &[Point3<f64>]) -> Vec<Point3<f64>> {
    let mut distance = vec![f64::INFINITY; viewpoints.len()];
    let mut chosen: Vec<Point3<f64>> = Vec::new();
    while chosen.len() < MAX_VIEWS {
        let farthest =
            (0..viewpoints.len()).rev().max_by(|&a, &b| distance[a].total_cmp(&distance[b]));
        let Some(next) = farthest.filter(|&i| distance[i] > 0.0).map(|i| viewpoints[i]) else {
            break;
        };
        for (d, viewpoint) in distance.iter_mut().zip(viewpoints) {
            *d = d.min((viewpoint - next).norm_squared());
        }
        chosen.push(next);
    }
    chosen
}

#[cfg(test)]
mod tests {
    use volery_synthetic::{Room, ScanOptions};

    use super::*;
    use crate::Surfels;

    /// Points in free space are seen through, points on surfaces and behind them are not. Next to
    /// a viewpoint the surface has holes, as it is made of pieces: two percent are allowed.
    #[test]
    fn space_before_surfaces_is_free_and_behind_them_unknown() {
        let room = Room::random(Vector3::new(8.0, 6.0, 3.0), 5.0, 4);
        let low = Point3::new(-2.0, -3.1, -0.1);
        let zone = room.scan(low, Point3::new(4.1, 3.1, 3.1), &ScanOptions::default(), 1);
        let surfels = Surfels::new(&zone.cloud, 0.05).unwrap();
        let seen = SeenSpace::new(surfels.pieces(), &zone.viewpoints);
        let [mut before, mut total, mut through, mut solid] = [0; 4];
        for piece in surfels.pieces().iter().step_by(20) {
            for depth in [0.0, 0.3] {
                let behind = piece.position - piece.normal * depth;
                if depth == 0.0 || !room.is_free(&behind, 0.05) {
                    through += usize::from(seen.is_seen_through(&behind, 0.2));
                    solid += 1;
                }
            }
            let free = piece.position + piece.normal * 0.6;
            if room.is_free(&free, 0.1) && low.x + 0.5 < free.x {
                before += usize::from(seen.is_seen_through(&free, 0.2));
                total += 1;
            }
        }
        assert!(before * 10 > total * 9, "{before} of {total}");
        assert!(solid > 500 && through * 50 < solid, "{through} of {solid}");
    }

    #[test]
    fn without_viewpoints_nothing_is_known() {
        let seen = SeenSpace::new(&[], &[]);
        assert!(!seen.is_seen_through(&Point3::origin(), 0.1));
        let nothing_there = SeenSpace::new(&[], &[Point3::origin(), Point3::origin()]);
        assert!(!nothing_there.is_seen_through(&Point3::new(1.0, 0.0, 0.0), 0.1));
        assert!(!nothing_there.is_seen_through(&Point3::origin(), 0.1));
    }
}
