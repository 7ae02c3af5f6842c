//! How near two vehicles come.

use std::time::Duration;

use nalgebra::Vector3;

use crate::motion::{Segment, Trajectory};

/// How far vehicles stay apart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Separation {
    /// Smallest distance allowed. Meters.
    pub distance: f64,
    /// How much a meter of height counts: below 1, since the air that a vehicle throws down
    /// disturbs the one beneath it.
    pub vertical_weight: f64,
}

impl Default for Separation {
    /// 1 m, heights count half.
    fn default() -> Self {
        Self { distance: 1.0, vertical_weight: 0.5 }
    }
}

impl Separation {
    /// Distance that counts, `√(x² + y² + (w z)²)`; never more than the true one.
    pub fn measure(&self, apart: &Vector3<f64>) -> f64 {
        self.weighted(apart).norm()
    }

    fn weighted(&self, apart: &Vector3<f64>) -> Vector3<f64> {
        Vector3::new(apart.x, apart.y, apart.z * self.vertical_weight)
    }

    /// Distance and weight are numbers that keep vehicles apart.
    pub fn is_valid(&self) -> bool {
        self.distance.is_finite()
            && self.distance > 0.0
            && self.vertical_weight > 0.0
            && self.vertical_weight <= 1.0
    }
}

/// Where two ways come nearest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Approach {
    /// Distance that counts. Meters.
    pub distance: f64,
    /// Time since the start.
    pub at: Duration,
}

/// Smallest distance between two vehicles over all time, also before and after their flights.
///
/// Exact between samples: on each span where both accelerate constantly the squared distance
/// `‖d + v t + a t²/2‖²` is a quartic in `t`, whose minimum is at an end or where its cubic
/// derivative vanishes.
pub fn closest_approach(a: &Trajectory, b: &Trajectory, separation: &Separation) -> Approach {
    let horizon = a.seconds().max(b.seconds());
    closest_between(a, b, 0.0, horizon, separation)
}

/// [`closest_approach`] from the time `from` to the time `to`. Seconds.
pub(crate) fn closest_between(
    a: &Trajectory,
    b: &Trajectory,
    from: f64,
    to: f64,
    separation: &Separation,
) -> Approach {
    let mut best = (f64::INFINITY, from);
    let mut t = from;
    loop {
        let (sa, sb) = (piece(a, t), piece(b, t));
        let end = sa.end().min(sb.end()).min(to);
        let (apart, v) = difference(&sa, &sb, t);
        let q = [apart, v, (sb.acceleration - sa.acceleration) * 0.5];
        let (squared, after) =
            smallest_squared(&q.map(|v| separation.weighted(&v)), (end - t).max(0.0));
        if squared < best.0 {
            best = (squared, t + after);
        }
        if end < to {
            t = end;
        } else {
            break; // also if a number is NaN
        }
    }
    Approach { distance: best.0.sqrt(), at: Duration::from_secs_f64(best.1.max(0.0)) }
}

/// Piece of the way at `t`; rest for ever after its end.
fn piece(way: &Trajectory, t: f64) -> Segment {
    way.segment_at(t).copied().unwrap_or_else(|| {
        let end = way.end();
        Segment::rest(crate::motion::LegKind::Wait, t, f64::INFINITY, end.position, end.yaw)
    })
}

fn difference(a: &Segment, b: &Segment, t: f64) -> (Vector3<f64>, Vector3<f64>) {
    let (ta, tb) = (t - a.start, t - b.start);
    (b.position_at(tb) - a.position_at(ta), b.velocity_at(tb) - a.velocity_at(ta))
}

/// Smallest `‖q₀ + q₁ t + q₂ t²‖²` for `0 ≤ t ≤ end`, and where.
fn smallest_squared(q: &[Vector3<f64>; 3], end: f64) -> (f64, f64) {
    let value = |t: f64| (q[0] + (q[1] + q[2] * t) * t).norm_squared();
    // half the derivative: c₀ + c₁ t + c₂ t² + c₃ t³
    let c = [
        q[0].dot(&q[1]),
        q[1].norm_squared() + 2.0 * q[0].dot(&q[2]),
        3.0 * q[1].dot(&q[2]),
        2.0 * q[2].norm_squared(),
    ];
    let derivative = |t: f64| c[0] + (c[1] + (c[2] + c[3] * t) * t) * t;
    // Between the extrema of the derivative it is monotone and has at most one zero.
    let mut cuts = [0.0, end, end, end];
    let extrema = quadratic_roots(c[1], 2.0 * c[2], 3.0 * c[3]);
    for (cut, root) in cuts[1..3].iter_mut().zip(extrema) {
        *cut = root.clamp(0.0, end);
    }
    let mut best = if value(end) < value(0.0) { (value(end), end) } else { (value(0.0), 0.0) };
    for pair in cuts.windows(2) {
        let (mut low, mut high) = (pair[0], pair[1]);
        if derivative(low) >= 0.0 || derivative(high) <= 0.0 {
            continue; // no minimum inside
        }
        while high - low > 1e-9 {
            let middle = 0.5 * (low + high);
            if derivative(middle) < 0.0 { low = middle } else { high = middle }
        }
        if value(low) < best.0 {
            best = (value(low), low);
        }
    }
    best
}

/// Real roots of `a + b t + c t²` in order; infinite where there are none.
fn quadratic_roots(a: f64, b: f64, c: f64) -> [f64; 2] {
    let discriminant = b * b - 4.0 * a * c;
    if c == 0.0 || discriminant < 0.0 {
        let only = if b == 0.0 || c != 0.0 { f64::INFINITY } else { -a / b };
        return [only, f64::INFINITY];
    }
    // The form that does not cancel.
    let w = -0.5 * (b + discriminant.sqrt().copysign(b));
    let (first, second) = (w / c, if w == 0.0 { w / c } else { a / w });
    [first.min(second), first.max(second)]
}

#[cfg(test)]
mod tests;
