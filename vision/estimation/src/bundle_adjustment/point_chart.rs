//! Coordinates in which a point moves: direction and inverse distance from a camera that sees it.
//!
//! A point seen under a small angle has a long, bent valley of equal cost in Cartesian
//! coordinates and a straight one in inverse distance, so that steps may be far longer.

use super::lens::fma;
use super::linearize::Pass;

/// Least factor of the inverse distance in one step.
const MIN_SHRINK: f64 = 0.1;

/// Coordinates `(a, b, s)` about a point at distance r from `origin` in the unit direction m with
/// normals t₁, t₂:
///
/// ```text
/// x(a, b, s) = origin + r / (1 + s) · (m + a t₁ + b t₂) / ‖·‖
/// ```
pub(super) struct PointChart {
    origin: [f64; 3],
    distance: f64,
    /// `t₁, t₂, −m`.
    axes: [[f64; 3]; 3],
}

impl PointChart {
    /// The chart from the first camera that sees the point, as the state has them.
    #[inline(always)]
    pub(super) fn new(pass: &Pass<'_>, point: usize) -> Self {
        let first = pass.layout.observation_poses[pass.layout.point_starts[point]];
        let origin = pass.state.poses[first as usize].center;
        let x = &pass.state.points[point];
        let b = [x[0] - origin[0], x[1] - origin[1], x[2] - origin[2]];
        let distance = (b[0] * b[0] + b[1] * b[1] + b[2] * b[2]).sqrt();
        let m =
            if distance > f64::MIN_POSITIVE { b.map(|v| v / distance) } else { [0.0, 0.0, 1.0] };
        // Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 2017.
        let sign = 1.0_f64.copysign(m[2]);
        let c = -1.0 / (sign + m[2]);
        let d = m[0] * m[1] * c;
        let t1 = [1.0 + sign * m[0] * m[0] * c, sign * d, -sign * m[0]];
        let t2 = [d, sign + m[1] * m[1] * c, -m[1]];
        Self { origin, distance: distance.max(f64::EPSILON), axes: [t1, t2, [-m[0], -m[1], -m[2]]] }
    }

    /// A row of derivatives by the point becomes one by `(a, b, s)`.
    #[inline(always)]
    pub(super) fn pull_back<const FMA: bool>(&self, row: &[f64; 3]) -> [f64; 3] {
        let [x, y, z] = [row[0] * self.distance, row[1] * self.distance, row[2] * self.distance];
        // Not `map`: what it calls is not inlined, and each product becomes a call of the C library.
        let along = |axis: &[f64; 3]| fma::<FMA>(x, axis[0], fma::<FMA>(y, axis[1], z * axis[2]));
        [along(&self.axes[0]), along(&self.axes[1]), along(&self.axes[2])]
    }

    /// The point at `(a, b, s)`; an inverse distance that would vanish shrinks to a tenth.
    #[inline(always)]
    pub(super) fn retract(&self, delta: &[f64; 3]) -> [f64; 3] {
        let [t1, t2, minus_m] = &self.axes;
        let direction: [f64; 3] =
            std::array::from_fn(|k| delta[0] * t1[k] + delta[1] * t2[k] - minus_m[k]);
        let norm2 = direction.iter().map(|v| v * v).sum::<f64>();
        let scale = self.distance / ((1.0 + delta[2]).max(MIN_SHRINK) * norm2.sqrt());
        std::array::from_fn(|k| self.origin[k] + scale * direction[k])
    }
}
