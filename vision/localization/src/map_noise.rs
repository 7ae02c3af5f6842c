//! How far the poses and points of a map are off, by the residuals of its adjustment.

mod gauge;
mod jackknife;
mod reduced;

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Matrix3, Point3, Vector2, Vector6};
use volery_geometry::{Linearized, linearize, median};
use volery_scene::{ImageId, Observation, Point3d, PointId, SparseModel};

/// No detector is finer, pixels per coordinate.
const MIN_SIGMA_PX: f64 = 0.1;

/// Scale of Cauchy's loss with which maps are adjusted, in medians of the residuals.
const LOSS_MEDIANS: f64 = 2.0;
/// Pull at the poses below which a map counts as adjusted with that loss.
const AT_REST: f64 = 0.1;

/// Noise of a map, in the gauge in which its camera centers fit the truth best.
pub(crate) struct MapNoise {
    /// Standard deviation of a keypoint per coordinate, pixels.
    pub(crate) sigma_px: f64,
    /// Of the images in order.
    pub(crate) poses: Vec<PoseNoise>,
    /// Per point `(Σ JᵀJ)⁻¹`, square map units per square pixel; `None` for points whose rays do
    /// not determine them.
    pub(crate) unit_covariances: BTreeMap<PointId, Matrix3<f64>>,
}

/// Columns of L, where the covariance of the left perturbations of two poses is `Σ_ab = Lₐ L_bᵀ`;
/// none for a pose that counts as exact.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct PoseNoise(pub(crate) Vec<Vector6<f32>>);

/// A sighting, linearized.
struct Sighting {
    /// Index of the image.
    image: usize,
    at: Linearized,
    residual: Vector2<f64>,
}

impl MapNoise {
    /// By the linearized bundle adjustment of `model`.
    pub(crate) fn of(model: &SparseModel) -> Self {
        let tracks = tracks(model);
        let sigma_px = keypoint_sigma_px(&tracks, model.images.len());
        let unit_covariances =
            tracks.iter().map(|track| (track.point, track.unit_covariance)).collect();
        let poses = jackknife::pose_noise(model, &tracks);
        Self { sigma_px, poses, unit_covariances }
    }
}

/// Standard deviation of a keypoint per coordinate, by the squares of the residuals and their
/// redundancy: what went into the points and the poses the residuals no longer show.
fn keypoint_sigma_px(tracks: &[Track], num_images: usize) -> f64 {
    let sightings = tracks.iter().flat_map(|track| &track.sightings);
    let squares: f64 = sightings.clone().map(|s| s.residual.norm_squared()).sum();
    let measured = 2.0 * sightings.count() as f64;
    let unknowns = 3.0 * tracks.len() as f64 + 6.0 * num_images as f64 - 7.0;
    (squares / (measured - unknowns).max(1.0)).sqrt().max(MIN_SIGMA_PX)
}

/// Cauchy's loss, c²/2 ln(1 + r²/c²).
#[derive(Clone, Copy)]
struct Loss {
    /// c², infinite for squares.
    squared_scale: f64,
    /// Share that counts of the negative curvature of sightings beyond the scale.
    concave: f64,
}

impl Loss {
    /// The loss under which the map is at rest, as it is and then less and less concave: a map whose
    /// adjustment was broken off is at no minimum of the first. None if its poses were given, not fitted
    /// to the sightings.
    fn shapes(tracks: &[Track]) -> impl Iterator<Item = Self> {
        let sightings = || tracks.iter().flat_map(|track| &track.sightings);
        let mut residuals: Vec<f64> = sightings().map(|s| s.residual.norm()).collect();
        let scale = (LOSS_MEDIANS * median(&mut residuals).unwrap_or(1.0)).max(MIN_SIGMA_PX);
        let [narrow, squares] =
            [scale * scale, f64::INFINITY].map(|c| Self { squared_scale: c, concave: 1.0 });
        let losses = [narrow, squares].map(|loss| (loss.unrest(tracks), loss));
        let at_rest = losses.into_iter().filter(|(unrest, _)| *unrest < AT_REST);
        let loss = at_rest.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, loss)| loss);
        let shapes = |loss| [1.0, 0.9, 0.5, 0.0].map(|concave| Self { concave, ..loss });
        loss.map(shapes).into_iter().flatten()
    }

    /// What pulls at the poses altogether, against the pulls one by one: 0 at rest, 1 or more for poses
    /// that were not fitted to the sightings.
    fn unrest(&self, tracks: &[Track]) -> f64 {
        let mut pulls: BTreeMap<usize, Vector6<f64>> = BTreeMap::new();
        let mut one_by_one = 0.0;
        for sighting in tracks.iter().flat_map(|track| &track.sightings) {
            let pull = sighting.at.by_pose.tr_mul(&self.derivatives(&sighting.residual).0);
            one_by_one += pull.norm_squared();
            *pulls.entry(sighting.image).or_default() += pull;
        }
        let together: f64 = pulls.values().map(|pull| pull.norm_squared()).sum();
        together / one_by_one.max(f64::MIN_POSITIVE)
    }

    /// Derivative ψ by the residual, and the second derivative: `w I − 2 w² r rᵀ / c²`.
    fn derivatives(&self, r: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
        let squared = r.norm_squared();
        let weight = 1.0 / (1.0 + squared / self.squared_scale);
        let along = 2.0 * weight * weight / self.squared_scale;
        let excess = (along - weight / squared.max(f64::MIN_POSITIVE)).max(0.0);
        let along = along - (1.0 - self.concave) * excess;
        (r * weight, Matrix2::identity() * weight - r * r.transpose() * along)
    }
}

/// A point with all that sees it.
struct Track {
    point: PointId,
    position: Point3<f64>,
    /// In the order of the images.
    sightings: Vec<Sighting>,
    /// `(Σ JᵀJ)⁻¹`
    unit_covariance: Matrix3<f64>,
}

/// Points that their rays determine.
fn tracks(model: &SparseModel) -> Vec<Track> {
    let index_of: BTreeMap<ImageId, usize> =
        model.images.keys().enumerate().map(|(index, id)| (*id, index)).collect();
    let track = |(&id, point): (&PointId, &Point3d)| {
        let sighting = |observation: &Observation| {
            let image = model.images.get(&observation.image)?;
            let camera = model.cameras.get(&image.camera)?;
            let at = linearize(camera, &image.cam_from_world, &point.position)?;
            let residual = at.pixel - image.keypoints.get(observation.keypoint as usize)?;
            Some(Sighting { image: index_of[&observation.image], at, residual })
        };
        let mut sightings: Vec<Sighting> = point.track.iter().filter_map(sighting).collect();
        sightings.sort_by_key(|s| s.image);
        let information: Matrix3<f64> =
            sightings.iter().map(|s| s.at.by_point.tr_mul(&s.at.by_point)).sum();
        let unit_covariance = information.cholesky()?.inverse();
        let is_determined = sightings.len() >= 2 && unit_covariance.iter().all(|v| v.is_finite());
        is_determined.then_some(Track {
            point: id,
            position: point.position,
            sightings,
            unit_covariance,
        })
    };
    model.points.iter().filter_map(track).collect()
}
