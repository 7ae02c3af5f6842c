//! Iterative closest points: pairs of nearest surface pieces, and the motion that brings them
//! together, in turns.

mod step;

use nalgebra::{Isometry3, Point3, Similarity3};
use rayon::prelude::*;
use volery_geometry::median;

use crate::constraint::{Constraint, Contact, Twist};
use crate::kernel::Kernel;
use crate::surfels::{Surfel, Surfels, center};
use crate::{Motion, RegistrationError};

/// Normals of a pair that differ by more are of different surfaces: cos 45°.
const MIN_NORMAL_COSINE: f64 = std::f64::consts::FRAC_1_SQRT_2;
/// Fewer pairs determine nothing worth having.
const MIN_PAIRS: usize = 20;
/// The search ends when a step moves the source by less than this share of the largest distance.
const CONVERGED: f64 = 1e-4;

/// What is brought together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Metric {
    /// Points onto points: the plain method of the paper (P54). Least squares; no kernel.
    PointToPoint,
    /// Points onto the planes of the target: they may slide along it.
    PointToPlane,
    /// Planes onto planes: the uncertainty of either surface along itself.
    #[default]
    Generalized,
}

/// How the pairs are made and judged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IcpOptions {
    /// Residual.
    pub metric: Metric,
    /// Degrees of freedom.
    pub motion: Motion,
    /// Robust loss.
    pub kernel: Kernel,
    /// Pairs farther apart are none, units of the target.
    pub max_distance: f64,
    /// Share of the pairs that is kept, the closest ones, 0..1.
    pub kept: f64,
    /// Most rounds of pairing and moving.
    pub max_iterations: usize,
}

impl Default for IcpOptions {
    fn default() -> Self {
        Self {
            metric: Metric::default(),
            motion: Motion::default(),
            kernel: Kernel::default(),
            max_distance: 0.5,
            kept: 1.0,
            max_iterations: 50,
        }
    }
}

/// Where the search ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Icp {
    /// The transform.
    pub target_from_source: Similarity3<f64>,
    /// Mean of the squared (for robust kernels: the lost) residuals of the kept pairs, before each
    /// step, squared units of the target.
    pub costs: Vec<f64>,
    /// Kept pairs at the end.
    pub num_pairs: usize,
    /// Root mean square of their residuals, units of the target.
    pub rms: f64,
    /// Whether the last step was too small to matter.
    pub converged: bool,
    /// What the pairs determine.
    pub constraint: Constraint,
}

/// Moves `source` from `start` until it lies on `target`.
///
/// With [`Metric::PointToPoint`] this is the method of the paper (P54): it minimizes
///
/// ```text
/// E(R, t) = 1/Nₚ Σᵢ ‖xᵢ − R pᵢ − t‖²
/// ```
///
/// over the pairs of each source point `pᵢ` with the nearest target point `xᵢ`; neither pairing
/// nor moving can raise it. Deterministic for any number of threads.
///
/// # Errors
///
/// [`RegistrationError::NoOverlap`] when fewer than twenty pairs are left, and
/// [`RegistrationError::Degenerate`] when they determine no motion.
///
/// # Source
///
/// Besl and McKay, "A Method for Registration of 3-D Shapes", PAMI 1992; Chen and Medioni, "Object
/// Modelling by Registration of Multiple Range Images", IVC 1992; Segal, Haehnel and Thrun,
/// "Generalized-ICP", RSS 2009; Chetverikov, Stepanov and Krsek, "Robust Euclidean Alignment of 3D
/// Point Sets: the Trimmed Iterative Closest Point Algorithm", IVC 2005.
pub fn icp(
    source: &[Surfel],
    target: &Surfels,
    start: &Similarity3<f64>,
    options: &IcpOptions,
) -> Result<Icp, RegistrationError> {
    check(options)?;
    let mut target_from_source = *start;
    let mut costs = Vec::new();
    let mut converged = false;
    let mut pairs = Vec::new();
    for _ in 0..options.max_iterations {
        pairs = pair(source, target, &target_from_source, options)?;
        let sigma = sigma(&pairs);
        costs.push(cost(&pairs, options, sigma));
        let moved = step::step(source, target, &target_from_source, &pairs, options, sigma)?;
        let size = moved_by(&pairs, &target_from_source, &moved);
        target_from_source = moved;
        converged = size < CONVERGED * options.max_distance.min(target.cell());
        if converged {
            break;
        }
    }
    let contacts: Vec<Contact> = pairs
        .iter()
        .map(|pair| {
            let normal = target.pieces()[pair.target as usize].normal;
            let position = target_from_source * source[pair.source as usize].position;
            let residual = normal.dot(&(position - target.pieces()[pair.target as usize].position));
            Contact { position, normal, residual }
        })
        .collect();
    let constraint = Constraint::new(&contacts, options.motion == Motion::Similarity);
    let sum: f64 = pairs.iter().map(|pair| pair.squared).sum();
    let rms = (sum / pairs.len().max(1) as f64).sqrt();
    Ok(Icp { target_from_source, costs, num_pairs: pairs.len(), rms, converged, constraint })
}

fn check(options: &IcpOptions) -> Result<(), RegistrationError> {
    let wrong = |name, got| Err(RegistrationError::Option { name, got });
    if options.max_distance.is_nan() || options.max_distance <= 0.0 {
        return wrong("max_distance", options.max_distance);
    }
    if !(options.kept > 0.0 && options.kept <= 1.0) {
        return wrong("kept", options.kept);
    }
    if options.max_iterations == 0 {
        return wrong("max_iterations", 0.0);
    }
    Ok(())
}

/// A source piece and the target piece nearest to it.
#[derive(Debug, Clone, Copy)]
struct Pair {
    source: u32,
    target: u32,
    /// Where the source piece is now.
    at: Point3<f64>,
    /// Squared residual of the metric.
    squared: f64,
}

fn pair(
    source: &[Surfel],
    target: &Surfels,
    target_from_source: &Similarity3<f64>,
    options: &IcpOptions,
) -> Result<Vec<Pair>, RegistrationError> {
    let rotation = target_from_source.isometry.rotation;
    let find = |(index, piece): (usize, &Surfel)| {
        let at = target_from_source * piece.position;
        let near = target.tree().nearest_within(&at, options.max_distance)?;
        let other = &target.pieces()[near.index as usize];
        let normal = rotation * piece.normal;
        let squared = match options.metric {
            Metric::PointToPoint => near.distance_squared,
            _ if normal.dot(&other.normal) < MIN_NORMAL_COSINE => return None,
            Metric::PointToPlane => other.normal.dot(&(at - other.position)).powi(2),
            Metric::Generalized => {
                let d = at - other.position;
                d.dot(&(step::information(&normal, &other.normal) * d))
            }
        };
        Some(Pair { source: index as u32, target: near.index, at, squared })
    };
    let found: Vec<Option<Pair>> =
        source.par_iter().enumerate().with_min_len(256).map(find).collect();
    let mut pairs: Vec<Pair> = found.into_iter().flatten().collect();
    if options.kept < 1.0 && !pairs.is_empty() {
        let kept = ((pairs.len() as f64 * options.kept).ceil() as usize).min(pairs.len());
        let key =
            |pair: &Pair| (pair.at - target.pieces()[pair.target as usize].position).norm_squared();
        pairs.select_nth_unstable_by(kept - 1, |a, b| {
            key(a).total_cmp(&key(b)).then(a.source.cmp(&b.source))
        });
        pairs.truncate(kept);
        pairs.sort_unstable_by_key(|pair| pair.source);
    }
    if pairs.len() < MIN_PAIRS {
        let overlap = pairs.len() as f64 / source.len().max(1) as f64;
        return Err(RegistrationError::NoOverlap { overlap, contradiction: 0.0 });
    }
    Ok(pairs)
}

fn sigma(pairs: &[Pair]) -> f64 {
    let mut residuals: Vec<f64> = pairs.iter().map(|pair| pair.squared.sqrt()).collect();
    (1.4826 * median(&mut residuals).unwrap_or(0.0)).max(f64::MIN_POSITIVE.sqrt())
}

fn cost(pairs: &[Pair], options: &IcpOptions, sigma: f64) -> f64 {
    let n = pairs.len() as f64;
    match (options.metric, options.kernel) {
        (Metric::PointToPoint, _) | (_, Kernel::Squared) => {
            pairs.iter().map(|pair| pair.squared).sum::<f64>() / n
        }
        (_, kernel) => {
            let loss = |pair: &Pair| kernel.loss(pair.squared.sqrt() / sigma);
            2.0 * sigma * sigma * pairs.iter().map(loss).sum::<f64>() / n
        }
    }
}

/// Root mean square motion of the paired points between two transforms.
fn moved_by(pairs: &[Pair], before: &Similarity3<f64>, after: &Similarity3<f64>) -> f64 {
    let change = after * before.inverse();
    let sum: f64 = pairs.iter().map(|pair| (change * pair.at - pair.at).norm_squared()).sum();
    (sum / pairs.len().max(1) as f64).sqrt()
}

/// The change of a [`Twist`] about a center.
pub(crate) fn similarity_from_twist(center: &Point3<f64>, twist: &Twist) -> Similarity3<f64> {
    let omega = twist.fixed_rows::<3>(0).into_owned();
    let rotation = nalgebra::UnitQuaternion::from_scaled_axis(omega);
    let scale = twist[6].exp();
    let moved = center.coords + twist.fixed_rows::<3>(3) - scale * (rotation * center.coords);
    Similarity3::from_isometry(Isometry3::from_parts(moved.into(), rotation), scale)
}

#[cfg(test)]
mod tests;
