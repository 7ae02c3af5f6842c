//! Gravity, scale, origin and forward vector: a reconstruction becomes an environment map.

mod gravity;
mod heights;
mod positions;
mod scale;
#[cfg(test)]
mod tests;

use nalgebra::{
    Isometry3, Matrix3, Point3, Rotation3, Similarity3, Translation3, Unit, UnitQuaternion, Vector3,
};
use volery_scene::{
    EnvironmentMap, Gravity, GravitySource, ImagePrior, KnownDistance, OriginRule, Quality,
    QualityReason, RegisteredImage, Scale, ScaleSource, SparseModel, Verdict,
};

use crate::Reconstruction;
use gravity::GravityEstimate;
use heights::fit_heights;
use positions::PositionFit;
use scale::ScaleEstimate;

/// Options of [`environment_map`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AlignOptions {
    /// Which point is the origin.
    pub origin: OriginRule,
    /// Measured distances.
    pub known_distances: Vec<KnownDistance>,
    /// The model stands in meters with z up already, by poses that were given so: it stays as it is.
    pub is_in_map_frame: bool,
}

/// A scale that is known worse is no metric scale.
const MAX_SCALE_SIGMA: f64 = 0.05;
/// Standard deviation of an up that is guessed from the cameras, radians.
const GUESSED_UP_SIGMA: f64 = 0.1;
/// Sources that differ by more combined standard deviations contradict each other.
const MAX_DEVIATIONS: f64 = 3.0;

/// The map of a reconstruction: z up, x forward (P50, P51), metric where a prior says so.
///
/// `priors[i]` belongs to `ImageId(i)`; missing ones count as empty. Of several sources of scale
/// or gravity the most precise wins; sources that contradict it by more than three standard
/// deviations are named in the verdict, which is then no longer good. With
/// [`OriginRule::Given`] the frame of the position priors is kept as it is; without positions
/// that determine it the origin is the last camera, and the map says so. A model that
/// [is in the map frame](AlignOptions::is_in_map_frame) stays there whatever the origin; sources
/// that contradict it are named all the same.
pub fn environment_map(
    reconstruction: Reconstruction,
    priors: &[ImagePrior],
    options: &AlignOptions,
) -> EnvironmentMap {
    let Reconstruction { models, unplaced, quality, .. } = reconstruction;
    let mut models = models.into_iter();
    let model = models.next().unwrap_or_default();
    let zones = models.map(|model| in_map_frame(model, quality_of_zone(), priors, options));
    let zones = zones.collect();
    EnvironmentMap { zones, unplaced, ..in_map_frame(model, quality, priors, options) }
}

/// Nobody validated it, and it is a part of something.
fn quality_of_zone() -> Quality {
    let reason = QualityReason {
        code: "zone".to_owned(),
        detail: "nothing ties this part to the map: take photos that show both".to_owned(),
    };
    Quality { verdict: Verdict::Suspect, reasons: vec![reason] }
}

fn in_map_frame(
    mut model: SparseModel,
    mut quality: Quality,
    priors: &[ImagePrior],
    options: &AlignOptions,
) -> EnvironmentMap {
    let fit = positions::fit_positions(&model, priors);
    let mut contradictions = Vec::new();
    let in_place = options.is_in_map_frame;
    let (up, gravity) = choose_gravity(&model, priors, fit.as_ref(), in_place, &mut contradictions);
    let heights = fit_heights(&model, priors, &up, gravity.sigma.unwrap_or(GUESSED_UP_SIGMA));
    let (up, gravity) = match &heights {
        Some(heights) if gravity.sigma.is_some_and(|sigma| heights.tilt_sigma < sigma) => {
            (heights.up, Gravity { sigma: Some(heights.tilt_sigma), ..gravity })
        }
        _ => (up, gravity),
    };
    let mut sources =
        scale::scales(&model, heights.as_ref(), fit.as_ref(), &options.known_distances);
    if in_place {
        sources.push(ScaleEstimate { factor: 1.0, sigma_rel: 0.0, source: ScaleSource::Poses });
    }
    let (factor, scale) = choose_scale(sources, &mut contradictions);

    let given = match (options.origin, &fit) {
        (OriginRule::Given, Some(fit)) if !in_place => fit.map_from_model,
        _ => None,
    };
    let (map_from_model, scale, gravity, origin) = match (given, &fit) {
        (Some(map_from_model), Some(fit)) => (
            map_from_model,
            Scale {
                metric: fit.scale_sigma_rel <= MAX_SCALE_SIGMA,
                source: ScaleSource::Positions,
                sigma_rel: (fit.scale_sigma_rel <= MAX_SCALE_SIGMA).then_some(fit.scale_sigma_rel),
            },
            Gravity { source: GravitySource::Positions, sigma: fit.tilt_sigma },
            OriginRule::Given,
        ),
        _ if in_place => (Similarity3::identity(), scale, gravity, OriginRule::Given),
        _ => {
            let origin = match options.origin {
                OriginRule::Given => OriginRule::LastCamera,
                rule => rule,
            };
            (levelled_frame(&model, &up, factor, origin), scale, gravity, origin)
        }
    };
    if !in_place {
        model.transform(&map_from_model);
    }
    if !contradictions.is_empty() {
        quality.verdict = quality.verdict.max(Verdict::Suspect);
        quality.reasons.append(&mut contradictions);
    }
    let (zones, unplaced) = (Vec::new(), Vec::new());
    EnvironmentMap { model, zones, unplaced, scale, gravity, origin, quality }
}

/// Up direction in the frame of the model, from the most precise source.
fn choose_gravity(
    model: &SparseModel,
    priors: &[ImagePrior],
    fit: Option<&PositionFit>,
    in_place: bool,
    contradictions: &mut Vec<QualityReason>,
) -> (Unit<Vector3<f64>>, Gravity) {
    let mut sources: Vec<GravityEstimate> = Vec::new();
    if in_place {
        let up = Vector3::z_axis();
        sources.push(GravityEstimate { up, sigma: 0.0, source: GravitySource::Poses });
    }
    sources.extend(gravity::from_attitudes(model, priors));
    if let Some(fit) = fit
        && let (Some(map_from_model), Some(sigma)) = (fit.map_from_model, fit.tilt_sigma)
    {
        let up = map_from_model.isometry.rotation.inverse() * Vector3::z_axis();
        sources.push(GravityEstimate { up, sigma, source: GravitySource::Positions });
    }
    sources.sort_by(|a, b| a.sigma.total_cmp(&b.sigma));
    let Some(best) = sources.first().copied() else {
        let gravity = Gravity { source: GravitySource::CameraUp, sigma: None };
        return (gravity::from_camera_axes(model), gravity);
    };
    for other in &sources[1..] {
        let angle = best.up.angle(&other.up);
        if angle > MAX_DEVIATIONS * best.sigma.hypot(other.sigma) {
            contradictions.push(QualityReason {
                code: "contradicting_gravity".to_owned(),
                detail: format!(
                    "{} and {} disagree about up by {:.1} degrees; the map follows the first",
                    name_of_gravity(best.source),
                    name_of_gravity(other.source),
                    angle.to_degrees()
                ),
            });
        }
    }
    (best.up, Gravity { source: best.source, sigma: told(best.sigma) })
}

/// A standard deviation, if the source tells one.
fn told(sigma: f64) -> Option<f64> {
    (sigma > 0.0).then_some(sigma)
}

/// Meters per model unit (1 when unknown) with its proof.
fn choose_scale(
    mut sources: Vec<ScaleEstimate>,
    contradictions: &mut Vec<QualityReason>,
) -> (f64, Scale) {
    sources.retain(|s| s.factor.is_finite() && s.factor > 0.0 && s.sigma_rel <= MAX_SCALE_SIGMA);
    sources.sort_by(|a, b| a.sigma_rel.total_cmp(&b.sigma_rel));
    let Some(best) = sources.first().copied() else {
        return (1.0, Scale { metric: false, source: ScaleSource::Unknown, sigma_rel: None });
    };
    for other in &sources[1..] {
        let difference = (other.factor / best.factor).ln().abs();
        if difference > MAX_DEVIATIONS * best.sigma_rel.hypot(other.sigma_rel) {
            contradictions.push(QualityReason {
                code: "contradicting_scale".to_owned(),
                detail: format!(
                    "{} say {:.1} % more or less than {}, which the map follows",
                    name_of_scale(other.source),
                    100.0 * (difference.exp() - 1.0),
                    name_of_scale(best.source)
                ),
            });
        }
    }
    let scale = Scale { metric: true, source: best.source, sigma_rel: told(best.sigma_rel) };
    (best.factor, scale)
}

fn name_of_gravity(source: GravitySource) -> &'static str {
    match source {
        GravitySource::CameraUp => "the cameras",
        GravitySource::Attitude => "the attitudes",
        GravitySource::Positions => "the positions",
        GravitySource::Poses => "the given poses",
        GravitySource::ControlPoints => "the control points",
        GravitySource::Given => "what was given by hand",
    }
}

fn name_of_scale(source: ScaleSource) -> &'static str {
    match source {
        ScaleSource::Unknown => "nothing",
        ScaleSource::Positions => "the positions",
        ScaleSource::Poses => "the given poses",
        ScaleSource::Heights => "the heights",
        ScaleSource::KnownDistance => "the known distances",
        ScaleSource::ControlPoints => "the control points",
        ScaleSource::Given => "what was given by hand",
    }
}

/// Frame with z along `up`, x along the levelled view of the last image (P51), origin by rule
/// (P50), lengths times `factor`.
fn levelled_frame(
    model: &SparseModel,
    up: &Unit<Vector3<f64>>,
    factor: f64,
    origin: OriginRule,
) -> Similarity3<f64> {
    let last = model.images.values().next_back();
    let forward = last.map_or(Vector3::x(), |image| levelled_forward(image, up));
    let left = up.cross(&forward).normalize();
    let forward = left.cross(up);
    let axes =
        Matrix3::from_rows(&[forward.transpose(), left.transpose(), up.into_inner().transpose()]);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    let center = match origin {
        OriginRule::MeanCameras => mean_center(model),
        _ => last.map_or(Point3::origin(), RegisteredImage::center),
    };
    let translation = -(rotation * center.coords) * factor;
    Similarity3::from_isometry(
        Isometry3::from_parts(Translation3::from(translation), rotation),
        factor,
    )
}

fn mean_center(model: &SparseModel) -> Point3<f64> {
    let sum: Vector3<f64> = model.images.values().map(|image| image.center().coords).sum();
    Point3::from(sum / (model.images.len().max(1) as f64))
}

/// Horizontal direction in which an image looks; a camera that looks straight down (or up) has its
/// heading at the top (bottom) of the image.
fn levelled_forward(image: &RegisteredImage, up: &Unit<Vector3<f64>>) -> Vector3<f64> {
    let world_from_cam = image.cam_from_world.rotation.inverse();
    let level = |v: Vector3<f64>| v - up.scale(up.dot(&v));
    let view = world_from_cam * Vector3::z();
    let levelled = level(view);
    // Within a degree of the vertical the levelled view is noise.
    let vertical = up.dot(&view);
    if levelled.norm() > 0.02 {
        return levelled;
    }
    level(world_from_cam * Vector3::y()) * vertical.signum()
}
