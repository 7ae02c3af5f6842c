//! How far the poses and points of a map are off, by the residuals of its adjustment.

mod modes;
mod reduced;

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Matrix6, Vector2, Vector6};
use volery_scene::{ImageId, Observation, Point3d, PointId, SparseModel};

use crate::jacobians::{Linearized, linearize};
use reduced::ReducedSystem;

/// No detector is finer, pixels per coordinate.
const MIN_SIGMA_PX: f64 = 0.1;

/// Beyond so many images the dense system takes too much memory: their poses count as exact.
const MAX_IMAGES: usize = 700;

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

/// The covariance of the left perturbations of two poses is `Σ_ab = Lₐ L_bᵀ`, and for one pose
/// `Σ_aa = Lₐ Lₐᵀ + Oₐ`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PoseNoise {
    /// Columns of L.
    pub(crate) shared: Vec<Vector6<f32>>,
    /// O.
    pub(crate) own: Matrix6<f32>,
}

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

        let num_images = if model.images.len() <= MAX_IMAGES { model.images.len() } else { 0 };
        let mut reduced = ReducedSystem::new(num_images);
        let mut unit_covariances = BTreeMap::new();
        for track in &tracks {
            if num_images > 0 {
                reduced.add(&track.sightings, &track.covariance);
            }
            unit_covariances.insert(track.point, track.covariance);
        }
        let poses = modes::pose_noise(model, reduced, sigma_px);
        Self { sigma_px, poses, unit_covariances }
    }
}

/// Standard deviation of a keypoint per coordinate, by the squares of the residuals and their
/// redundancy: what went into the points and the poses the residuals no longer show.
///
/// The adjustment's loss holds the large ones down and so errs less than least squares would by the
/// same residuals. That gain is not claimed: it would be right if keypoints erred one by one, but
/// those of a region, and of one track, err together.
fn keypoint_sigma_px(tracks: &[Track], num_images: usize) -> f64 {
    let sightings = tracks.iter().flat_map(|track| &track.sightings);
    let squares: f64 = sightings.clone().map(|s| s.residual.norm_squared()).sum();
    let measured = 2.0 * sightings.count() as f64;
    let unknowns = 3.0 * tracks.len() as f64 + 6.0 * num_images as f64 - 7.0;
    (squares / (measured - unknowns).max(1.0)).sqrt().max(MIN_SIGMA_PX)
}

/// A point with all that sees it.
struct Track {
    point: PointId,
    /// In the order of the images.
    sightings: Vec<Sighting>,
    /// `(Σ JᵀJ)⁻¹`
    covariance: Matrix3<f64>,
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
        let covariance = information.cholesky()?.inverse();
        let is_determined = sightings.len() >= 2 && covariance.iter().all(|v| v.is_finite());
        is_determined.then_some(Track { point: id, sightings, covariance })
    };
    model.points.iter().filter_map(track).collect()
}
