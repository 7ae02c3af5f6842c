//! The covariance of the poses by what each part of the room, left out, moves them.

use nalgebra::{DMatrix, DVector, Vector6};
use volery_cholesky::inverse;
use volery_geometry::median;
use volery_scene::SparseModel;

use super::gauge::Gauge;
use super::reduced::ReducedSystem;
use super::{Loss, PoseNoise, Track};

/// The parts are halved so often, each with about as many points.
const MAX_HALVINGS: u32 = 7;
/// Points of a part at least, as far as there are so many.
const MIN_POINTS: usize = 8;
/// Beyond so many images the dense system takes too much memory: their poses count as exact.
const MAX_IMAGES: usize = 700;
/// Information that holds the gauge, relative to the greatest.
const GAUGE_HOLD: f64 = 1e-3;
/// Share of a part's information that is left out with it, so that a pose that only one part
/// sees is not without any.
const LEFT_OUT: f64 = 0.95;
/// The steps of conjugate gradients, and the squared residual at which they end.
const MAX_STEPS: usize = 50;
const TOLERANCE: f64 = 1e-8;

/// Delete-a-group jackknife: the keypoints of one part of the room, and of one track, err together,
/// and wrong ones among them bend the map; the parts err apart. Each part g is one mode
///
/// ```text
/// L_g = P (S − S_g)⁻¹ s_g
/// ```
///
/// where S, s are the reduced system at the map's poses and P takes the similarity out. Leaving the
/// part out gives back what the fitted poses have taken out of its residuals. Cameron & Miller, "A
/// practitioner's guide to cluster-robust inference", Journal of Human Resources 2015.
pub(super) fn pose_noise(model: &SparseModel, tracks: &[Track]) -> Vec<PoseNoise> {
    let num_images = model.images.len();
    let modes = modes(model, tracks).unwrap_or_default();
    let of_image =
        |mode: &DVector<f64>, image: usize| Vector6::from_fn(|row, _| mode[6 * image + row] as f32);
    (0..num_images)
        .map(|image| PoseNoise(modes.iter().map(|mode| of_image(mode, image)).collect()))
        .collect()
}

fn modes(model: &SparseModel, tracks: &[Track]) -> Option<Vec<DVector<f64>>> {
    if model.images.len() > MAX_IMAGES {
        return None;
    }
    let gauge = Gauge::of(model, median_depth(tracks, model)?)?;
    let all: Vec<&Track> = tracks.iter().collect();
    let (loss, covariance) = Loss::shapes(tracks).find_map(|loss| {
        let whole = ReducedSystem::of(&all, &loss);
        let information = held(whole.hessian, &gauge)?;
        let n = information.nrows();
        Some((loss, DMatrix::from_vec(n, n, inverse(n, information.data.into())?)))
    })?;
    let mode = |part: Vec<&Track>| {
        let system = ReducedSystem::of(&part, &loss);
        let rows = system.rows();
        let columns = covariance.select_columns(&rows);
        let own = columns.select_rows(&rows);
        gauge.taken_out_of(columns * without(&system, &own))
    };
    Some(parts(all).into_iter().map(mode).collect())
}

/// With information on the gauge added; `None` if the tracks do not hold all poses.
fn held(mut hessian: DMatrix<f64>, gauge: &Gauge) -> Option<DMatrix<f64>> {
    let basis = gauge.basis();
    if hessian.nrows() != basis.nrows() {
        return None;
    }
    let hold = GAUGE_HOLD * hessian.diagonal().max();
    hessian.gemm(hold, &basis, &basis.transpose(), 1.0);
    Some(hessian)
}

/// `(I − S_g C)⁻¹ s_g`, with C the covariance of the part's poses, by conjugate gradients on
/// `C − C S_g C` preconditioned by C.
fn without(part: &ReducedSystem, covariance: &DMatrix<f64>) -> DVector<f64> {
    let mut solution = DVector::zeros(part.gradient.len());
    let mut z = part.gradient.clone();
    let mut residual = covariance * &z;
    let mut direction = z.clone();
    let mut squared = residual.dot(&z);
    let first = squared;
    for _ in 0..MAX_STEPS {
        if squared <= TOLERANCE * first {
            break;
        }
        let step = &direction - &part.hessian * (covariance * &direction) * LEFT_OUT;
        let moved = covariance * &step;
        let curvature = direction.dot(&moved);
        if curvature <= 0.0 {
            break;
        }
        let length = squared / curvature;
        solution += &direction * length;
        residual -= moved * length;
        z -= step * length;
        let next = residual.dot(&z);
        direction = &z + direction * (next / squared);
        squared = next;
    }
    solution
}

/// Neighboring points together, by halving at the median along the axis on which they spread most.
fn parts(tracks: Vec<&Track>) -> Vec<Vec<&Track>> {
    let halvings = (tracks.len() / MIN_POINTS).max(1).ilog2().min(MAX_HALVINGS);
    let mut parts = vec![tracks];
    for _ in 0..halvings {
        parts = parts.into_iter().flat_map(halved).collect();
    }
    parts
}

fn halved(mut tracks: Vec<&Track>) -> [Vec<&Track>; 2] {
    let spread = |axis: usize| {
        let values = tracks.iter().map(|track| track.position[axis]);
        let mean = values.clone().sum::<f64>() / tracks.len() as f64;
        values.map(|value| (value - mean).powi(2)).sum::<f64>()
    };
    let axis = (0..3).max_by(|&a, &b| spread(a).total_cmp(&spread(b))).unwrap_or(0);
    tracks.sort_by(|a, b| a.position[axis].total_cmp(&b.position[axis]));
    let rest = tracks.split_off(tracks.len() / 2);
    [tracks, rest]
}

fn median_depth(tracks: &[Track], model: &SparseModel) -> Option<f64> {
    let images: Vec<_> = model.images.values().collect();
    let depths = tracks.iter().filter_map(|track| {
        let first = track.sightings.first()?;
        Some((images[first.image].cam_from_world * track.position).coords.norm())
    });
    median(&mut depths.collect::<Vec<_>>()).filter(|depth| depth.is_finite() && *depth > 0.0)
}
