//! The global mapper: all rotations, then all positions, then refinement.
//!
//! It needs no pair with parallax to start from, so it maps scans that mostly turn in place.

mod laplacian;
mod parallax;
pub mod positioning;
pub mod rotation_averaging;
mod starts;
#[cfg(test)]
mod tests;
pub mod triplets;

use nalgebra::{Unit, Vector3};
use volery_estimation::BundleOptions;
use volery_geometry::Camera;
use volery_geometry::frames::enu_from_camera;
use volery_scene::{Cancelled, Progress, SparseModel, Stage, TwoViewGeometry, TwoViewKind};

pub use positioning::{PositioningOptions, Positions, RayObservation, position_globally};
pub use rotation_averaging::{RotationAverage, RotationEdge, average_rotations};
pub use triplets::weigh_by_triplets;

use crate::incremental::{Input, WorkingModel, relative_pose};
use crate::tracks::build_tracks;
use crate::{MapperOptions, SfmCamera, SfmImage};
use parallax::has_parallax;

/// Residual, radians, from which a pair contradicts the averaged rotations and its matches are
/// left out.
const MAX_EDGE_RESIDUAL: f64 = 5.0 * std::f64::consts::PI / 180.0;
/// Inliers from which more make a pair's rotation no more believable.
const MAX_EDGE_WEIGHT: usize = 300;
/// A smaller component is no map.
const MIN_IMAGES: usize = 3;
/// Least triangulation angle, radians, of a point while the map is built: scans in place have
/// little more.
const MIN_ANGLE: f64 = 0.25 * std::f64::consts::PI / 180.0;

/// Models of the images, largest first, each in a frame of its own; empty if the images have no
/// parallax between them.
///
/// Arguments as for [`crate::map_incrementally`].
///
/// Source: Pan, Baráth, Pollefeys & Schönberger, "Global Structure-from-Motion Revisited", ECCV
/// 2024, for the order of the steps.
pub fn map_globally(
    images: &[SfmImage],
    cameras: &[SfmCamera],
    start: &[Camera],
    pairs: &[TwoViewGeometry],
    options: &MapperOptions,
    progress: &dyn Progress,
) -> Result<Vec<SparseModel>, Cancelled> {
    progress.check()?;
    let sound: Vec<TwoViewGeometry> =
        pairs.iter().filter(|p| is_sound(p, images)).cloned().collect();
    let first = Input { images, cameras, pairs: &sound, options };
    let empty = WorkingModel::new(first, start.to_vec(), &[], vec![true; images.len()]);
    let average = rotations(&empty, images);

    let agreeing: Vec<TwoViewGeometry> = sound
        .iter()
        .zip(&average.residuals)
        .filter(|(_, residual)| **residual <= MAX_EDGE_RESIDUAL)
        .map(|(pair, _)| pair.clone())
        .collect();
    let options = MapperOptions { min_angle: options.min_angle.min(MIN_ANGLE), ..*options };
    let input = Input { images, cameras, pairs: &agreeing, options: &options };
    let tracks = build_tracks(images, &agreeing);
    let mut model = WorkingModel::new(input, start.to_vec(), &tracks, vec![true; images.len()]);
    progress.report(Stage::Mapping, 0, images.len());
    if average.cam_from_world.iter().flatten().count() < MIN_IMAGES
        || !model.position(&average.cam_from_world, progress)?
    {
        return Ok(Vec::new());
    }
    progress.check()?;
    model.adjust_coarsely(progress)?;
    model.renew_points(progress)?;
    if !has_parallax(&model) {
        return Ok(Vec::new());
    }
    model.finish(progress)?;
    if model.num_registered() < MIN_IMAGES || !has_parallax(&model) {
        return Ok(Vec::new());
    }
    progress.report(Stage::Mapping, model.num_registered(), images.len());
    Ok(vec![model.to_sparse()])
}

/// Whether the images of a pair exist.
fn is_sound(pair: &TwoViewGeometry, images: &[SfmImage]) -> bool {
    pair.image1 != pair.image2 && (pair.image1.0.max(pair.image2.0) as usize) < images.len()
}

/// Averaged rotations of the pairs; residuals in their order, infinite for pairs without a
/// rotation.
fn rotations(model: &WorkingModel<'_>, images: &[SfmImage]) -> RotationAverage {
    let pairs = model.input.pairs;
    let mut edges: Vec<RotationEdge> = pairs
        .iter()
        .map(|pair| {
            let pose = relative_pose(model, pair);
            // A plane leaves two decompositions, and E from a guessed focal length is off.
            let trust = match pair.kind {
                TwoViewKind::General | TwoViewKind::RotationOnly => 1.0,
                TwoViewKind::Planar | TwoViewKind::Uncalibrated => 0.3,
            };
            RotationEdge {
                i: pair.image1.0 as usize,
                j: pair.image2.0 as usize,
                j_from_i: pose.unwrap_or_default().rotation,
                weight: match pose {
                    Some(_) => trust * pair.num_inliers().min(MAX_EDGE_WEIGHT) as f64,
                    None => 0.0,
                },
            }
        })
        .collect();
    weigh_by_triplets(images.len(), &mut edges);
    average_rotations(images.len(), &edges, &ups(images))
}

/// Direction of up in the camera frame of the images whose attitude is known.
fn ups(images: &[SfmImage]) -> Vec<Option<(Unit<Vector3<f64>>, f64)>> {
    images
        .iter()
        .map(|image| {
            let attitude = image.prior.attitude?;
            let enu_from_cam = enu_from_camera(attitude.yaw, attitude.pitch, attitude.roll);
            let up = Unit::new_normalize(enu_from_cam.inverse() * Vector3::z());
            Some((up, attitude.sigma_tilt))
        })
        .collect()
}

/// Losses of the coarse adjustments, pixels, and the error beyond which a sighting takes no part,
/// in multiples of the mapper's limit.
const COARSE: [(f64, f64); 3] = [(16.0, 25.0), (4.0, 5.0), (1.0, 2.0)];

impl WorkingModel<'_> {
    /// Adjusts with a loss that narrows from what positioning leaves to what pixels allow.
    fn adjust_coarsely(&mut self, progress: &dyn Progress) -> Result<(), Cancelled> {
        for (loss_scale_px, limit) in COARSE {
            self.activate_within(limit * self.input.options.max_error_px);
            let options = BundleOptions {
                max_iterations: 30,
                loss_scale_px: Some(loss_scale_px),
                cost_tolerance: 1e-4,
            };
            self.adjust_all(&options, progress)?;
        }
        self.activate_within(self.input.options.max_error_px);
        Ok(())
    }

    /// Makes every point anew from the poses: one that ran off during the adjustments would never
    /// come back by small steps, and its pull bends the poses.
    fn renew_points(&mut self, progress: &dyn Progress) -> Result<(), Cancelled> {
        for track in &mut self.tracks {
            track.clear();
        }
        let all: Vec<usize> = (0..self.tracks.len()).collect();
        self.triangulate_tracks(&all);
        let options =
            BundleOptions { max_iterations: 30, loss_scale_px: Some(1.0), cost_tolerance: 1e-5 };
        self.adjust_all(&options, progress)
    }

    /// Lets exactly the sightings within `max_error_px` of their point take part.
    fn activate_within(&mut self, max_error_px: f64) {
        for track in 0..self.tracks.len() {
            let Some(point) = self.tracks[track].position else { continue };
            for slot in 0..self.tracks[track].sightings.len() {
                let sighting = self.tracks[track].sightings[slot];
                self.tracks[track].sightings[slot].active =
                    self.reprojection_error(&sighting, &point) <= max_error_px;
            }
            if self.tracks[track].num_active() < 2 {
                self.tracks[track].clear();
            }
        }
    }
}
