//! What an overlap says about the motion of the source, and what it leaves free.

use nalgebra::{DMatrix, Matrix6, Point3, SMatrix, SVector, SymmetricEigen, Vector3};
use volery_geometry::median;

use crate::FreeDirection;

/// A change of a similarity in the target frame: `x ↦ c + e^λ Exp(ω) (x − c) + τ`, in the order
/// `ω, τ, λ`, where `c` is a center.
pub type Twist = SVector<f64, 7>;
/// Of [`Twist`]s.
pub type TwistMatrix = SMatrix<f64, 7, 7>;

/// A contact resists a motion if the motion would move it within 60° of its normal (cosine). Less
/// is also what a plane with noisy normals would seem to resist.
const FIRM: f64 = 0.5;
/// Contacts that share their information: the planes of neighboring pieces come from the same
/// points. Measured: without it the normalized squared error of zones is 29 on average instead
/// of 6.
const SHARED: f64 = 5.0;
/// Share of turns and growth in a motion that is a slide.
const SLIDING: f64 = 0.1;
/// A direction is held if this share of the contacts resists it.
const LEAST_FIRM_SHARE: f64 = 0.01;

/// A place where the zones touch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// In the target frame.
    pub position: Point3<f64>,
    /// Of the target, unit.
    pub normal: Vector3<f64>,
    /// Distance along the normal.
    pub residual: f64,
}

/// How well a transform is known.
#[derive(Debug, Clone, PartialEq)]
pub struct Constraint {
    /// The center of the twists, in the target frame.
    pub center: Point3<f64>,
    /// Inverse covariance of the twist about the center. Without scale its row is zero.
    pub information: TwistMatrix,
    /// Standard deviation of the residuals.
    pub sigma: f64,
    /// Motions that nothing resists.
    pub free: Vec<FreeDirection>,
}

impl Constraint {
    /// Of contacts that a motion of six (`with_scale`: seven) degrees of freedom has to explain.
    ///
    /// Directions are judged by the share of contacts that resist them, not by their eigenvalue
    /// alone, which noise in the normals lifts on a bare plane, too.
    ///
    /// # Source
    ///
    /// Tuna, Nubert, Nava, Khattak and Hutter, "X-ICP: Localizability-Aware LiDAR Registration",
    /// TRO 2024, section IV, with directions of the whole motion instead of its two halves.
    pub fn new(contacts: &[Contact], with_scale: bool) -> Self {
        let center = crate::surfels::center(contacts.iter().map(|c| c.position));
        let n = contacts.len().max(1) as f64;
        let radius =
            (contacts.iter().map(|c| (c.position - center).norm_squared()).sum::<f64>() / n).sqrt();
        let radius = radius.max(f64::MIN_POSITIVE);
        // Lengths in radii, so that turns and slides weigh alike.
        let row = |contact: &Contact| {
            let arm = (contact.position - center) / radius;
            let normal = contact.normal;
            let scale = if with_scale { arm.dot(&normal) } else { 0.0 };
            twist(&arm.cross(&normal), &normal, scale)
        };
        let mut sum = TwistMatrix::zeros();
        contacts.iter().map(row).for_each(|row| sum += row * row.transpose());

        let size = if with_scale { 7 } else { 6 };
        let eigen = SymmetricEigen::new(sum.view((0, 0), (size, size)).into_owned());
        let is_firm = |contact: &Contact, motion: &Twist| {
            let arm = (contact.position - center) / radius;
            let omega = motion.fixed_rows::<3>(0).into_owned();
            let moved = omega.cross(&arm) + motion.fixed_rows::<3>(3) + arm * motion[6];
            contact.normal.dot(&moved).abs() > FIRM * moved.norm()
        };
        let is_free = |motion: &Twist| {
            let firm = contacts.iter().filter(|contact| is_firm(contact, motion)).count();
            (firm as f64) < LEAST_FIRM_SHARE * n
        };
        let free: Vec<Twist> = eigen
            .eigenvectors
            .column_iter()
            .map(|vector| Twist::from_fn(|k, _| if k < size { vector[k] } else { 0.0 }))
            .filter(is_free)
            .collect();

        let mut residuals: Vec<f64> = contacts.iter().map(|c| c.residual.abs()).collect();
        // The median absolute deviation of normal residuals.
        let sigma = 1.4826 * median(&mut residuals).unwrap_or(0.0);
        let unit = twist(&Vector3::repeat(radius), &Vector3::repeat(1.0), radius);
        let variance = (SHARED * sigma * sigma).max(f64::MIN_POSITIVE);
        let information = TwistMatrix::from_fn(|i, j| sum[(i, j)] * unit[i] * unit[j] / variance);
        Self { center, information, sigma, free: named(&free) }
    }

    /// Covariance of `(ω, τ)` about the center; `None` where a motion is free.
    pub fn covariance(&self) -> Option<Matrix6<f64>> {
        let has_scale = self.information[(6, 6)] > 0.0;
        let whole = if has_scale {
            self.information.try_inverse()?.fixed_view::<6, 6>(0, 0).into_owned()
        } else {
            self.information.fixed_view::<6, 6>(0, 0).try_inverse()?
        };
        (self.free.is_empty() && whole.iter().all(|v| v.is_finite())).then_some(whole)
    }
}

pub(crate) fn twist(omega: &Vector3<f64>, tau: &Vector3<f64>, lambda: f64) -> Twist {
    Twist::from_fn(|k, _| match k {
        0..3 => omega[k],
        3..6 => tau[k - 3],
        _ => lambda,
    })
}

/// The motions of a space in the order scale, turns, slides: a basis in which no motion turns
/// that can do without.
fn named(basis: &[Twist]) -> Vec<FreeDirection> {
    if basis.is_empty() {
        return Vec::new();
    }
    let motion =
        |weights: &[f64]| -> Twist { basis.iter().zip(weights).map(|(b, w)| b * *w).sum() };
    // Σ of the singular values tells how much of each basis motion is a turn or a growth.
    let turning = DMatrix::from_fn(4, basis.len(), |i, j| basis[j][if i < 3 { i } else { 6 }]);
    let gram = turning.transpose() * turning;
    let eigen = SymmetricEigen::new(gram);
    let mut motions: Vec<(f64, Twist)> = (0..basis.len())
        .map(|k| {
            (eigen.eigenvalues[k], motion(eigen.eigenvectors.column(k).into_owned().as_slice()))
        })
        .collect();
    motions.sort_by(|a, b| b.0.total_cmp(&a.0));
    let name = |(turning, motion): (f64, Twist)| {
        let part = |from: usize| Vector3::new(motion[from], motion[from + 1], motion[from + 2]);
        if turning < SLIDING {
            FreeDirection::Slide(upward(part(3)))
        } else if motion[6].abs() > part(0).norm() {
            FreeDirection::Scale
        } else {
            FreeDirection::Turn(upward(part(0)))
        }
    };
    motions.into_iter().map(name).collect()
}

/// Of a vector and its opposite the one whose largest component is positive, of unit length.
fn upward(v: Vector3<f64>) -> Vector3<f64> {
    (v * v[v.iamax()].signum()).normalize()
}

#[cfg(test)]
mod tests {
    use volery_geometry::Rng;

    use super::*;

    fn contacts(
        n: usize,
        normal_noise: f64,
        mut surface: impl FnMut(&mut Rng) -> (Vector3<f64>, Vector3<f64>),
    ) -> Vec<Contact> {
        let mut rng = Rng::new(5);
        (0..n)
            .map(|_| {
                let (p, n) = surface(&mut rng);
                let normal = (n + rng.normal3() * normal_noise).normalize();
                Contact { position: Point3::from(p), normal, residual: 0.01 * rng.normal() }
            })
            .collect()
    }

    fn is_along(found: &FreeDirection, slides: bool, axis: Vector3<f64>) -> bool {
        match found {
            FreeDirection::Slide(v) if slides => v.dot(&axis).abs() > 0.99,
            FreeDirection::Turn(v) if !slides => v.dot(&axis).abs() > 0.99,
            _ => false,
        }
    }

    /// Noise of 6 degrees in the normals does not hold a plane.
    #[test]
    fn a_plane_slides_both_ways_and_turns() {
        let plane = contacts(3000, 0.1, |rng| {
            (Vector3::new(rng.range(3.0, 7.0), rng.range(-2.0, 3.0), 1.0), Vector3::z())
        });
        let found = Constraint::new(&plane, false).free;
        assert_eq!(found.len(), 3, "{found:?}");
        assert!(is_along(&found[0], false, Vector3::z()), "{found:?}");
        for slide in &found[1..] {
            assert!(matches!(slide, FreeDirection::Slide(v) if v.z.abs() < 0.1), "{found:?}");
        }
    }

    fn corridor(rng: &mut Rng) -> (Vector3<f64>, Vector3<f64>) {
        let x = rng.range(0.0, 12.0);
        match rng.index(4) {
            0 => (Vector3::new(x, 0.0, rng.range(0.0, 2.5)), Vector3::y()),
            1 => (Vector3::new(x, 2.0, rng.range(0.0, 2.5)), -Vector3::y()),
            2 => (Vector3::new(x, rng.range(0.0, 2.0), 0.0), Vector3::z()),
            _ => (Vector3::new(x, rng.range(0.0, 2.0), 2.5), -Vector3::z()),
        }
    }

    #[test]
    fn a_corridor_slides_along_itself_until_a_door_frame_holds_it() {
        let bare = Constraint::new(&contacts(4000, 0.05, corridor), false);
        assert_eq!(bare.free.len(), 1, "{:?}", bare.free);
        assert!(is_along(&bare.free[0], true, Vector3::x()), "{:?}", bare.free);
        assert_eq!(bare.covariance(), None);
        let with_frames = contacts(4000, 0.05, |rng| {
            if rng.chance(0.03) {
                let x = if rng.chance(0.5) { 3.0 } else { 8.0 };
                (Vector3::new(x, rng.range(0.0, 0.2), rng.range(0.0, 2.0)), Vector3::x())
            } else {
                corridor(rng)
            }
        });
        let held = Constraint::new(&with_frames, false);
        assert!(held.free.is_empty(), "{:?}", held.free);
        let covariance = held.covariance().unwrap();
        // Along the corridor 120 contacts of 4000 hold it, across about half of them.
        assert!(covariance[(3, 3)] > 5.0 * covariance[(4, 4)]);
    }

    #[test]
    fn a_ball_turns_and_a_pipe_slides_and_turns() {
        let ball = contacts(3000, 0.05, |rng| {
            let n = rng.normal3().normalize();
            (n * 2.0 + Vector3::new(5.0, 0.0, 1.0), -n)
        });
        let found = Constraint::new(&ball, false).free;
        assert_eq!(found.len(), 3);
        assert!(found.iter().all(|f| matches!(f, FreeDirection::Turn(_))), "{found:?}");
        let pipe = contacts(3000, 0.05, |rng| {
            let a = rng.range(0.0, std::f64::consts::TAU);
            let n = Vector3::new(0.0, a.cos(), a.sin());
            (n * 1.5 + Vector3::x() * rng.range(-5.0, 5.0), n)
        });
        let found = Constraint::new(&pipe, false).free;
        assert_eq!(found.len(), 2, "{found:?}");
        assert!(is_along(&found[0], false, Vector3::x()), "{found:?}");
        assert!(is_along(&found[1], true, Vector3::x()), "{found:?}");
    }

    /// Three walls that meet in a corner look the same when they grow from it.
    #[test]
    fn a_corner_has_no_scale_but_a_room_has() {
        let wall = |rng: &mut Rng, far: f64| {
            let k = rng.index(3);
            let mut p = Vector3::from_fn(|_, _| rng.range(0.0, 4.0));
            let mut n = Vector3::zeros();
            let is_far = rng.chance(far);
            p[k] = if is_far { 4.0 } else { 0.0 };
            n[k] = if is_far { -1.0 } else { 1.0 };
            (p, n)
        };
        let corner = contacts(3000, 0.02, |rng| wall(rng, 0.0));
        assert_eq!(Constraint::new(&corner, false).free, []);
        assert_eq!(Constraint::new(&corner, true).free, [FreeDirection::Scale]);
        let room = contacts(3000, 0.02, |rng| wall(rng, 0.5));
        assert_eq!(Constraint::new(&room, true).free, []);
    }

    /// The covariance predicts how far least squares moves under noise.
    #[test]
    fn the_covariance_is_that_of_least_squares() {
        let mut sum = Matrix6::zeros();
        let mut predicted = Matrix6::zeros();
        for seed in 0..300 {
            let mut rng = Rng::new(seed);
            let contacts: Vec<Contact> = contacts(300, 0.0, |rng| {
                let (p, n) = corridor(rng);
                if rng.chance(0.1) { (p, Vector3::x()) } else { (p, n) }
            })
            .into_iter()
            .map(|c| Contact { residual: 0.01 * rng.normal(), ..c })
            .collect();
            let constraint = Constraint::new(&contacts, false);
            let mut h = Matrix6::zeros();
            let mut g = nalgebra::Vector6::zeros();
            for c in &contacts {
                let arm = c.position - constraint.center;
                let row =
                    twist(&arm.cross(&c.normal), &c.normal, 0.0).fixed_rows::<6>(0).into_owned();
                h += row * row.transpose();
                g += row * c.residual;
            }
            let moved = h.try_inverse().unwrap() * g;
            sum += moved * moved.transpose() / 300.0;
            predicted += constraint.covariance().unwrap() / 300.0;
        }
        for k in 0..6 {
            // Variances of 300 draws: standard error 8 %; that of sigma from the median comes on top.
            let ratio = SHARED * sum[(k, k)] / predicted[(k, k)];
            assert!((0.7..1.4).contains(&ratio), "{k}: {ratio}");
        }
    }
}
