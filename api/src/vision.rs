//! Cameras, alignment and poses on the wire.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::{KnownDistance, PositionPrior};

/// Intrinsics under COLMAP's names and parameter order, first pixel center at (0.5, 0.5).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Camera {
    /// `SIMPLE_PINHOLE`, `PINHOLE`, `SIMPLE_RADIAL`, `RADIAL`, `OPENCV`, `OPENCV_FISHEYE` or
    /// `FULL_OPENCV`.
    pub model: String,
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// In the order of the model, pixels for focal lengths and principal point.
    pub params: Vec<f64>,
}

/// A camera model and the order of its parameters.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct CameraModel {
    /// COLMAP's name.
    pub model: String,
    /// Names in order.
    pub params: Vec<String>,
}

/// Models with the order of their parameters.
pub const CAMERA_MODELS: [(&str, &[&str]); 7] = [
    ("SIMPLE_PINHOLE", &["f", "cx", "cy"]),
    ("PINHOLE", &["fx", "fy", "cx", "cy"]),
    ("SIMPLE_RADIAL", &["f", "cx", "cy", "k1"]),
    ("RADIAL", &["f", "cx", "cy", "k1", "k2"]),
    ("OPENCV", &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"]),
    ("OPENCV_FISHEYE", &["fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4"]),
    ("FULL_OPENCV", &["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"]),
];

impl Camera {
    /// What is wrong with it, if anything: unknown model, wrong number of parameters, sizes or
    /// focal lengths that cannot be.
    pub fn problem(&self) -> Option<String> {
        let Some((_, names)) = CAMERA_MODELS.iter().find(|(name, _)| *name == self.model) else {
            return Some(format!("unknown camera model {:?}", self.model));
        };
        if self.params.len() != names.len() {
            let (model, got) = (&self.model, self.params.len());
            return Some(format!("{model} takes {} parameters, got {got}", names.len()));
        }
        if self.width == 0 || self.height == 0 || self.width.max(self.height) > 65_535 {
            return Some(format!("impossible size {} x {}", self.width, self.height));
        }
        if self.params.iter().any(|value| !value.is_finite()) {
            return Some("parameters must be finite".to_owned());
        }
        names
            .iter()
            .zip(&self.params)
            .find(|(name, value)| name.starts_with('f') && **value <= 0.0)
            .map(|(name, value)| format!("{name} must be positive, got {value}"))
    }
}

/// Which point is the origin of a map.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum OriginRule {
    /// Position of the last mapping image.
    #[default]
    LastCamera,
    /// Mean of the camera positions.
    MeanCameras,
    /// The frame of the position priors or control points is kept as it is, or the map was moved.
    Given,
}

/// A surveyed point and where it is seen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ControlPoint {
    /// x, y, z in meters, z up.
    #[schema(min_items = 3, max_items = 3)]
    pub position: [f64; 3],
    /// At least two sightings.
    pub observations: Vec<ControlObservation>,
}

/// One sighting of a surveyed point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct ControlObservation {
    /// Image name.
    pub image: String,
    /// Pixels, first pixel center (0.5, 0.5).
    #[schema(min_items = 2, max_items = 2)]
    pub pixel: [f64; 2],
}

/// A similarity: `x_in_new = scale * rotation * x_in_map + translation`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Sim3 {
    /// Unit quaternion w, x, y, z.
    #[schema(min_items = 4, max_items = 4)]
    pub rotation: [f64; 4],
    /// Meters.
    #[schema(min_items = 3, max_items = 3)]
    pub translation: [f64; 3],
    /// Positive.
    pub scale: f64,
    /// Whether lengths are meters afterwards.
    #[serde(default)]
    pub metric: bool,
    /// Standard deviation of `scale` relative to it, where something tells it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma_rel: Option<f64>,
}

impl Sim3 {
    /// What is wrong with it, if anything.
    pub fn problem(&self) -> Option<String> {
        if !(self.scale.is_finite() && self.scale > 0.0) {
            return Some(format!("the scale must be positive, got {}", self.scale));
        }
        if self.sigma_rel.is_some_and(|sigma| !(sigma.is_finite() && sigma > 0.0)) {
            return Some("sigma_rel must be positive".to_owned());
        }
        pose_problem(&self.translation, &self.rotation)
    }
}

/// Exactly one way to change the frame of a map.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum AlignRequest {
    /// Sets the scale.
    KnownDistance(KnownDistance),
    /// Sets rotation, translation and scale.
    Sim3(Sim3),
    /// Fits rotation, translation and scale to at least three surveyed points.
    ControlPoints(Vec<ControlPoint>),
}

/// Where the camera may be.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LocalizePrior {
    /// Position in the map, meters.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub position: Option<PositionPrior>,
    /// Rotation of the camera's forward axis about map z from map x, radians.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub yaw: Option<YawPrior>,
}

/// A yaw in the map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct YawPrior {
    /// Radians, counter-clockwise seen from above.
    pub yaw: f64,
    /// Standard deviation, radians.
    pub sigma: f64,
}

/// Position and orientation of a camera in the map: `map_from_camera`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CameraPose {
    /// x, y, z in the map, meters when the map is metric.
    #[schema(min_items = 3, max_items = 3)]
    pub position: [f64; 3],
    /// Unit quaternion w, x, y, z that turns camera axes (x right, y down, z forward) into the
    /// map's.
    #[schema(min_items = 4, max_items = 4)]
    pub orientation: [f64; 4],
}

impl CameraPose {
    /// What is wrong with it, if anything.
    pub fn problem(&self) -> Option<String> {
        pose_problem(&self.position, &self.orientation)
    }
}

/// A quaternion may be written with few digits.
const MAX_NORM_ERROR: f64 = 1e-3;

/// What keeps a position and a quaternion from being a pose, if anything.
pub(crate) fn pose_problem(position: &[f64; 3], orientation: &[f64; 4]) -> Option<String> {
    let norm = orientation.iter().map(|v| v * v).sum::<f64>().sqrt();
    if !position.iter().chain([&norm]).all(|v| v.is_finite()) {
        Some("numbers must be finite".to_owned())
    } else if (norm - 1.0).abs() > MAX_NORM_ERROR {
        Some(format!("the rotation must be a unit quaternion w, x, y, z, its length is {norm}"))
    } else {
        None
    }
}

/// Whether an image found its place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum LocalizeStatus {
    /// One pose stands out.
    Ok,
    /// Several poses are about as good.
    Ambiguous,
    /// None.
    NotFound,
}

/// How a photo is placed.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum LocalizeMethod {
    /// By features; if that finds nothing, a prior with position and yaw is given and the map has a
    /// mesh, by comparing the photo with rendered views. Every pose is checked by its render score.
    #[default]
    Auto,
    /// By features only, without a render score.
    Pnp,
    /// By comparing the photo with rendered views around the prior's position.
    Template,
}

/// A pose that is about as good as another.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Rival {
    /// `map_from_camera`.
    pub pose: CameraPose,
    /// Inliers of the pose.
    pub num_inliers: u32,
}

/// Milliseconds per step.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct LocalizeTimings {
    /// Bytes to pixels.
    pub decode_ms: Option<f64>,
    /// Keypoints and descriptors.
    pub features_ms: Option<f64>,
    /// Retrieval and matching.
    pub match_ms: Option<f64>,
    /// RANSAC and refinement.
    pub solve_ms: Option<f64>,
    /// From the arrival of the request to the answer.
    pub total_ms: Option<f64>,
}

/// The answer to one image. A photo that cannot be placed is an answer, not an error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Localization {
    /// Whether there is a pose.
    pub status: LocalizeStatus,
    /// `map_from_camera`; with `ok` only.
    pub pose: Option<CameraPose>,
    /// 6 x 6, row-major: position x, y, z in the map (m), then rotation about map x, y, z (rad).
    pub covariance: Option<Vec<f64>>,
    /// Stable code; with `not_found` and `ambiguous`.
    pub reason: Option<String>,
    /// With `ambiguous`, best first.
    #[serde(default)]
    pub rivals: Vec<Rival>,
    /// Features of the image.
    #[serde(default)]
    pub num_features: u32,
    /// 2D-3D correspondences.
    #[serde(default)]
    pub num_correspondences: u32,
    /// Inliers of the pose.
    #[serde(default)]
    pub num_inliers: u32,
    /// Inliers over correspondences.
    pub inlier_ratio: Option<f64>,
    /// Root mean square reprojection error, pixels.
    pub reprojection_px: Option<f64>,
    /// `pnp` or `template`: which way answered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method: Option<LocalizeMethod>,
    /// How well the map's mesh, drawn from the pose, agrees with the photo; if there is a mesh.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub render_score: Option<RenderScore>,
    /// Light and sharpness of the photo; with `template`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light: Option<PhotoLight>,
    /// Milliseconds per step.
    #[serde(default)]
    pub timings: LocalizeTimings,
}

/// A drawn view against a photo: a second opinion on a pose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct RenderScore {
    /// Part of the view's patches that the photo shows within a pixel of where they should be, 0 to
    /// 1; some 0.04 by chance.
    pub agreement: f64,
    /// Correlation of local contrasts, -1 to 1.
    pub correlation: f64,
    /// Patches that were looked for.
    pub num_patches: u32,
    /// Part of the view that shows the map, 0 to 1.
    pub seen: f64,
}

/// Light and sharpness of a photo: `photo = gain * map ^ gamma`, levels in 0..1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PhotoLight {
    /// Factor at mid gray.
    pub gain: f64,
    /// Exponent.
    pub gamma: f64,
    /// Strength of the finest edges over that of edges at half the size; nearly 1 when sharp.
    pub sharpness: f64,
    /// Whether the photo lacks its finest details.
    pub is_blurred: bool,
    /// Whether the light is another one than when the map was made.
    pub is_other_light: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CameraMount;

    #[test]
    fn a_pose_is_a_finite_place_and_a_unit_quaternion() {
        assert_eq!(CameraMount::default().problem(), None);
        // Few digits are enough.
        let pose = CameraPose { position: [1.0, 2.0, 3.0], orientation: [0.707, 0.0, 0.707, 0.0] };
        assert_eq!(pose.problem(), None);
        for (position, orientation) in [
            ([f64::NAN, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]),
            ([0.0; 3], [1.0, 1.0, 0.0, 0.0]),
            ([0.0; 3], [0.0; 4]),
            ([0.0; 3], [f64::INFINITY, 0.0, 0.0, 0.0]),
            ([0.0; 3], [1.0, f64::NAN, 0.0, 0.0]),
        ] {
            assert!(
                pose_problem(&position, &orientation).is_some(),
                "{position:?} {orientation:?}"
            );
        }
    }
}
