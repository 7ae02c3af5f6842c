//! Images placed again by what the others see.
//!
//! A narrow loss has many minima: an image whose sightings hold the points that hold it can stay
//! where it first came to rest, and keep its neighbors from where they belong. The points as the
//! other images alone see them know nothing of that place.

use nalgebra::{Isometry3, Matrix2, Matrix3, Matrix6, Point2, Point3, Vector3, Vector6};
use rayon::prelude::*;
use volery_geometry::{Camera, linearize, perturbed};

use super::working::{Track, WorkingModel};

/// Scales of the losses in turn, standard deviations of a keypoint; the last is that of the Cauchy
/// distribution with the same median.
const LOSS_SIGMAS: [f64; 4] = [8.0, 3.0, 1.5, 0.68];
/// Steps per loss.
const MAX_STEPS: usize = 10;
/// Squared step, radians and map units, that ends a loss.
const SMALL_STEP: f64 = 1e-16;
/// Median error of two dimensions, in standard deviations of one: √(2 ln 2).
const MEDIAN_SIGMAS: f64 = 1.1774;
/// Steps to the point without the image.
const NUM_POINT_STEPS: usize = 3;
/// A point that is less certain, as part of its distance, tells nothing.
const MAX_POINT_SIGMA: f64 = 0.3;
/// Squared distance from the pose by the others, in its standard deviations, beyond which they
/// contradict the pose: 99.7 % of χ²₆.
const CONTRADICTION: f64 = 20.0;
/// Sightings needed of points that the others determine.
const MIN_SIGHTINGS: usize = 20;

/// A pixel of the image and the point as the other images see it.
struct Sight {
    pixel: Point2<f64>,
    point: Point3<f64>,
    covariance: Matrix3<f64>,
}

impl WorkingModel<'_> {
    /// Images whose poses the points as the others see them contradict, with the poses by those.
    pub(crate) fn poses_by_the_others(&self) -> Vec<(usize, Isometry3<f64>)> {
        let Some(median_px) = self.median_error_px() else { return Vec::new() };
        let sigma_px = (median_px / MEDIAN_SIGMAS).max(f64::MIN_POSITIVE);
        let again = |(image, pose): (usize, &Option<Isometry3<f64>>)| {
            let pose = (*pose)?;
            let sights = self.sights_without(image, sigma_px);
            let (anew, information) = resect(&sights, self.camera(image), &pose, sigma_px)?;
            let moved = perturbation(&pose, &anew);
            (moved.dot(&(information * moved)) > CONTRADICTION).then_some((image, anew))
        };
        self.poses.par_iter().enumerate().filter_map(again).collect()
    }

    /// Cost of the active sightings under Cauchy's loss of the scale given, pixels. Those beyond the
    /// error limit, which are dropped next, count as if they were at the limit.
    pub(crate) fn robust_cost(&self, loss_scale_px: f64) -> f64 {
        let limit_px = self.input.options.max_error_px;
        let of_track = |track: &Track| -> f64 {
            let Some(point) = track.position else { return 0.0 };
            let active = track.sightings.iter().filter(|s| s.active);
            let errors = active.map(|s| self.reprojection_error(s, &point).min(limit_px));
            errors.map(|error| (error / loss_scale_px).powi(2).ln_1p()).sum()
        };
        self.tracks.iter().map(of_track).sum()
    }

    fn sights_without(&self, image: usize, sigma_px: f64) -> Vec<Sight> {
        let sight = |&(track, slot): &(u32, u32)| {
            let track = &self.tracks[track as usize];
            let own = track.sightings[slot as usize];
            if !own.active || track.num_active() < 3 {
                return None;
            }
            let (point, covariance) = self.point_without(track, image, sigma_px)?;
            Some(Sight { pixel: self.pixel(&own), point, covariance })
        };
        self.image_tracks[image].iter().filter_map(sight).collect()
    }

    /// The point of a track by the images but one, with its covariance.
    fn point_without(
        &self,
        track: &Track,
        image: usize,
        sigma_px: f64,
    ) -> Option<(Point3<f64>, Matrix3<f64>)> {
        let start = track.position?;
        let mut point = start;
        let mut covariance = Matrix3::zeros();
        let mut nearest = f64::INFINITY;
        for _ in 0..NUM_POINT_STEPS {
            let mut information = Matrix3::zeros();
            let mut gradient = Vector3::zeros();
            for sighting in track.sightings.iter().filter(|s| s.active && s.image as usize != image)
            {
                let other = sighting.image as usize;
                let pose = self.poses[other]?;
                let at = linearize(self.camera(other), &pose, &point)?;
                let residual = at.pixel - self.pixel(sighting);
                let squared = residual.norm_squared() / (sigma_px * sigma_px);
                let weight = weight(squared, super::LOSS_MEDIANS * MEDIAN_SIGMAS);
                information += at.by_point.tr_mul(&at.by_point) * weight;
                gradient += at.by_point.tr_mul(&residual) * weight;
                nearest = nearest.min((pose * point).coords.norm());
            }
            covariance = information.cholesky()?.inverse();
            point -= covariance * gradient;
        }
        covariance *= sigma_px * sigma_px;
        let is_held = covariance.trace().sqrt() < MAX_POINT_SIGMA * nearest
            && (point - start).norm() < MAX_POINT_SIGMA * nearest;
        is_held.then_some((point, covariance))
    }
}

/// Weight of Cauchy's loss.
fn weight(squared: f64, scale: f64) -> f64 {
    1.0 / (1.0 + squared / (scale * scale))
}

/// ξ with `anew = perturbed(pose, ξ)`.
fn perturbation(pose: &Isometry3<f64>, anew: &Isometry3<f64>) -> Vector6<f64> {
    let turn = anew.rotation * pose.rotation.inverse();
    let (omega, tau) =
        (turn.scaled_axis(), anew.translation.vector - turn * pose.translation.vector);
    Vector6::new(omega.x, omega.y, omega.z, tau.x, tau.y, tau.z)
}

/// Minimizes over the pose `Σ ρ(rᵀ S⁻¹ r)`, S = σ² I + J C Jᵀ, with losses ρ that narrow. Returns
/// the pose and its information.
fn resect(
    sights: &[Sight],
    camera: &Camera,
    initial: &Isometry3<f64>,
    sigma_px: f64,
) -> Option<(Isometry3<f64>, Matrix6<f64>)> {
    if sights.len() < MIN_SIGHTINGS {
        return None;
    }
    let mut pose = *initial;
    let mut information = Matrix6::zeros();
    for scale in LOSS_SIGMAS {
        for _ in 0..MAX_STEPS {
            let mut gradient = Vector6::zeros();
            information.fill(0.0);
            for sight in sights {
                let Some(at) = linearize(camera, &pose, &sight.point) else { continue };
                let noise = at.by_point * sight.covariance * at.by_point.transpose()
                    + Matrix2::identity() * (sigma_px * sigma_px);
                let inverse = noise.try_inverse()?;
                let residual = at.pixel - sight.pixel;
                let weight = weight(residual.dot(&(inverse * residual)), scale);
                let weighted = at.by_pose.tr_mul(&inverse) * weight;
                information += weighted * at.by_pose;
                gradient += weighted * residual;
            }
            let step = -information.cholesky()?.solve(&gradient);
            pose = perturbed(&pose, &step);
            if step.norm_squared() < SMALL_STEP {
                break;
            }
        }
    }
    pose.translation.vector.iter().all(|v| v.is_finite()).then_some((pose, information))
}

#[cfg(test)]
mod tests {
    use volery_geometry::{CameraModel, Rng};

    use super::*;

    const SIGMA_PX: f64 = 0.2;

    /// 200 sights of exact points with normal noise, one in eight a pixel or two beside.
    fn sights(camera: &Camera, pose: &Isometry3<f64>, rng: &mut Rng) -> Vec<Sight> {
        let sight = |index: usize, rng: &mut Rng| {
            let point =
                Point3::new(rng.range(-3.0, 3.0), rng.range(-2.0, 2.0), rng.range(3.0, 9.0));
            let seen = camera.project(&(pose * point)).unwrap();
            let wrong = if index.is_multiple_of(8) { 1.5 } else { 0.0 };
            let noise =
                nalgebra::Vector2::new(rng.normal() * SIGMA_PX + wrong, rng.normal() * SIGMA_PX);
            Sight { pixel: seen + noise, point, covariance: Matrix3::identity() * 1e-6 }
        };
        (0..200).map(|index| sight(index, rng)).collect()
    }

    /// An image that the others agree with stays; one that is off by a few pixels is brought back,
    /// wrong sights or not.
    #[test]
    fn only_contradicted_poses_move() {
        let camera =
            Camera::new(CameraModel::Pinhole, 640, 480, &[500.0, 500.0, 320.0, 240.0]).unwrap();
        let truth = Isometry3::identity();
        for seed in 0..20 {
            let mut rng = Rng::new(seed);
            let sights = sights(&camera, &truth, &mut rng);
            let near = |pose: &Isometry3<f64>| {
                let (anew, information) = resect(&sights, &camera, pose, SIGMA_PX).unwrap();
                let moved = perturbation(pose, &anew);
                (anew, moved.dot(&(information * moved)))
            };
            let (at_truth, distance) = near(&truth);
            assert!(distance < CONTRADICTION, "seed {seed}: {distance}");
            let off = perturbed(&truth, &Vector6::new(2e-3, -4e-3, 1e-3, 0.01, 0.02, -0.03));
            let (anew, distance) = near(&off);
            assert!(distance > CONTRADICTION, "seed {seed}: {distance}");
            assert!(perturbation(&at_truth, &anew).norm() < 1e-6, "seed {seed}");
        }
    }

    /// ξ of two poses moves the one to the other.
    #[test]
    fn perturbation_is_the_inverse_of_perturbed() {
        let xi = Vector6::new(0.02, -0.03, 0.01, 0.4, -0.2, 0.1);
        let pose = perturbed(&Isometry3::identity(), &Vector6::new(0.5, 0.2, -0.9, 1.0, 2.0, 3.0));
        assert!((perturbation(&pose, &perturbed(&pose, &xi)) - xi).norm() < 1e-12);
    }
}
