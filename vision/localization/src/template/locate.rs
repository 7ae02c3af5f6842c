//! From a photo, a surface and a rough place to a pose that is believed.

use nalgebra::{Isometry3, Matrix3, Point2, Point3, Translation3, UnitQuaternion, Vector3};
use volery_estimation::absolute_pose::{
    AbsolutePoseOptions, RefinedPose, estimate_absolute_pose, refine_absolute_pose,
};
use volery_geometry::Camera;
use volery_geometry::triangulation::camera_center;
use volery_rendering::{DrawableMesh, VirtualCamera};
use volery_scene::GrayImage;

use super::align::{Aligned, align, telling_points};
use super::coarse::{Area, Candidate, search};
use super::key_view::KeyView;
use super::light::{Light, is_blurred};
use super::patches::{PatchMatch, PatchMatches, RenderScore, View};
use super::similarity::Similarity;
use super::surface_share::surface_share;
use super::working::{Working, radius_at};
use crate::acceptance::{covariance_in_map, num_cells};
use crate::localize::{LocalizationPrior, NotFoundReason, PoseEstimate, Status};
use crate::refine::{Sight, refine_weighted};

/// Which places are searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SearchSide {
    /// All around the last position.
    #[default]
    Around,
    /// Not behind the plane through the last position across the heading (P71): for drones that fly
    /// forward.
    Ahead,
}

/// Options of [`localize_by_template`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TemplateOptions {
    /// How far around the last position places are searched, meters.
    pub radius: f64,
    /// Which of them.
    pub side: SearchSide,
    /// How views are compared in the search.
    pub similarity: Similarity,
}

impl Default for TemplateOptions {
    fn default() -> Self {
        Self { radius: 0.6, side: SearchSide::Around, similarity: Similarity::Correlation }
    }
}

/// The answer to one photo.
#[derive(Debug, Clone, PartialEq)]
pub struct TemplateAnswer {
    /// Whether there is a pose.
    pub status: Status,
    /// What speaks for it, or for the best that was not believed.
    pub proof: Option<TemplateProof>,
    /// Places whose view was compared.
    pub num_places: usize,
}

/// What speaks for a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TemplateProof {
    /// The view from the pose against the photo.
    pub score: RenderScore,
    /// Light and sharpness of the photo.
    pub light: Light,
}

/// Candidates that are aligned, and of these, that are looked at closely.
const NUM_ALIGNED: usize = 4;
const NUM_REFINED: usize = 2;
const ALIGN_ITERATIONS: usize = 12;
/// A rival this much as alike as the best is looked at, too.
const RIVAL_PART: f64 = 0.85;
/// Rounds of drawing, matching patches and resection: how far patches are looked for and the inlier
/// threshold, pixels of the finest level.
const ROUNDS: [(usize, f64); 2] = [(8, 2.0), (4, 1.5)];

/// Hypotheses of a round at most.
const MAX_ITERATIONS: usize = 300;

/// Least part of the view that must show the map.
const MIN_SEEN: f64 = 0.4;
/// Fewest patches that support a pose, and the least part of those looked for.
const MIN_INLIERS: usize = 20;
const MIN_INLIER_RATIO: f64 = 0.35;
/// Fewest cells of the image with support.
const MIN_CELLS: usize = 8;
/// Least agreement of the final view.
const MIN_AGREEMENT: f64 = 0.3;
/// Greatest standard deviations: part of the median depth, and degrees.
const MAX_RELATIVE_SIGMA: f64 = 0.03;
const MAX_SIGMA_DEG: f64 = 0.5;
/// Farther from the prior than so many of its deviations, a pose contradicts it.
const MAX_PRIOR_SIGMAS: f64 = 4.0;
/// Poses farther apart are different places: part of the median depth, and degrees.
const SAME_PLACE: f64 = 0.1;
const SAME_ROTATION_DEG: f64 = 5.0;

/// The pose of a photo near a place, by comparing it with views of the mesh (P62-P73).
///
/// Views with the drone's field of view, level and at the yaw of `prior`, are compared with the
/// photo around the position of `prior`; the most alike are centered, then aligned by all their
/// pixels; patches of the view from there are looked for in the photo, and what they show, by the
/// view's depth, gives the pose and its covariance by resection. It is believed only if enough
/// patches in all parts of the image support it, if the view from it agrees with the photo, and
/// if it does not contradict the prior.
///
/// Deterministic.
pub fn localize_by_template(
    photo: &GrayImage,
    camera: &Camera,
    mesh: &DrawableMesh,
    prior: &LocalizationPrior,
    options: &TemplateOptions,
) -> TemplateAnswer {
    let refuse = |reason, num_places| TemplateAnswer {
        status: Status::NotFound(reason),
        proof: None,
        num_places,
    };
    let (Some((position, _)), Some((yaw, _))) = (prior.position, prior.yaw) else {
        return refuse(NotFoundReason::NoPrior, 0);
    };
    let Some(working) = Working::new(photo, camera) else {
        return refuse(NotFoundReason::TooSmall, 0);
    };
    let start = level_pose(&position, yaw);
    let Some(key) = key_view(&working, mesh, &start) else {
        return refuse(NotFoundReason::NothingInView, 0);
    };
    let area = Area {
        cam_from_world: start,
        radius: options.radius,
        only_ahead: options.side == SearchSide::Ahead,
        similarity: options.similarity,
    };
    let candidates = search(&key, &working.levels[2], &area);
    let aligned = align_all(&key, &working, &candidates.found);
    let finder = Finder {
        working: &working,
        mesh,
        eye: VirtualCamera::new(&working.levels[0].camera),
        original_scale: f64::from(camera.width) / f64::from(working.levels[0].camera.width),
    };
    let mut believed: Vec<Located> = Vec::new();
    let mut first: Option<(NotFoundReason, Option<TemplateProof>)> = None;
    for pose in &aligned {
        match finder.refine(&pose.cam_from_world, prior) {
            Ok(located) => believed.push(located),
            Err(doubt) => {
                first.get_or_insert(doubt);
            }
        }
    }
    believed.sort_by(|a, b| b.proof.score.agreement.total_cmp(&a.proof.score.agreement));
    let num_places = candidates.num_places;
    let Some(best) = believed.first() else {
        let (reason, proof) = first.unwrap_or((NotFoundReason::NotAlike, None));
        let reason = if is_blurred(&working) { NotFoundReason::Blurred } else { reason };
        return TemplateAnswer { status: Status::NotFound(reason), proof, num_places };
    };
    let proof = Some(best.proof);
    let mut poses = vec![best.estimate.clone()];
    poses
        .extend(believed[1..].iter().filter(|o| is_elsewhere(best, o)).map(|o| o.estimate.clone()));
    let status =
        if poses.len() > 1 { Status::Ambiguous(poses) } else { Status::Ok(poses.swap_remove(0)) };
    TemplateAnswer { status, proof, num_places }
}

/// A level camera that looks along `yaw`, radians from x towards y.
pub(crate) fn level_pose(position: &Point3<f64>, yaw: f64) -> Isometry3<f64> {
    let (sin, cos) = yaw.sin_cos();
    // Columns: the camera's right, down and forward.
    let world_from_cam = Matrix3::new(sin, 0.0, cos, -cos, 0.0, sin, 0.0, -1.0, 0.0);
    let rotation = nalgebra::Rotation3::from_matrix_unchecked(world_from_cam);
    let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
    Isometry3::from_parts(Translation3::from(position.coords), rotation).inverse()
}

fn key_view(working: &Working, mesh: &DrawableMesh, start: &Isometry3<f64>) -> Option<KeyView> {
    let level = &working.levels[1];
    let eye = VirtualCamera::new(&KeyView::camera(level)?);
    let drawn = eye.draw_mesh(mesh, start);
    if drawn.seen_part() < MIN_SEEN {
        return None;
    }
    let key = KeyView::new(&eye, &drawn, radius_at(&level.camera), start);
    (key.median_depth > 0.0).then_some(key)
}

/// The candidates where all their points fit, best first.
fn align_all(key: &KeyView, working: &Working, candidates: &[Candidate]) -> Vec<Aligned> {
    let points = telling_points(key);
    let aligned = |start: &Isometry3<f64>, level: usize| {
        align(key, &points, &working.levels[level], start, ALIGN_ITERATIONS)
    };
    let by_correlation = |a: &Aligned, b: &Aligned| b.correlation.total_cmp(&a.correlation);
    let mut rough: Vec<Aligned> =
        candidates.iter().filter_map(|c| aligned(&c.cam_from_world, 2)).collect();
    rough.sort_by(by_correlation);
    let fine = rough.iter().take(NUM_ALIGNED).filter_map(|a| aligned(&a.cam_from_world, 1));
    let mut fine: Vec<Aligned> = fine.collect();
    fine.sort_by(by_correlation);
    let mut distinct: Vec<Aligned> = Vec::new();
    for candidate in fine {
        let near = |other: &Aligned| {
            is_same_place(&other.cam_from_world, &candidate.cam_from_world, key.median_depth)
        };
        let is_alike = distinct
            .first()
            .is_none_or(|best| candidate.correlation > RIVAL_PART * best.correlation);
        if is_alike && !distinct.iter().any(near) {
            distinct.push(candidate);
        }
    }
    distinct.truncate(NUM_REFINED);
    distinct
}

fn is_same_place(a: &Isometry3<f64>, b: &Isometry3<f64>, median_depth: f64) -> bool {
    (camera_center(a) - camera_center(b)).norm() < SAME_PLACE * median_depth
        && a.rotation.angle_to(&b.rotation) < SAME_ROTATION_DEG.to_radians()
}

/// A pose that passed all tests.
struct Located {
    cam_from_world: Isometry3<f64>,
    median_depth: f64,
    estimate: PoseEstimate,
    proof: TemplateProof,
}

fn is_elsewhere(a: &Located, b: &Located) -> bool {
    !is_same_place(&a.cam_from_world, &b.cam_from_world, a.median_depth)
}

struct Finder<'a> {
    working: &'a Working,
    mesh: &'a DrawableMesh,
    /// Of the finest level.
    eye: VirtualCamera,
    /// Pixels of the photo per pixel of the finest level.
    original_scale: f64,
}

type Doubt = (NotFoundReason, Option<TemplateProof>);

impl Finder<'_> {
    /// Draws, matches and resects until the pose stands, then judges it.
    fn refine(
        &self,
        initial: &Isometry3<f64>,
        prior: &LocalizationPrior,
    ) -> Result<Located, Doubt> {
        let not_alike = |proof| (NotFoundReason::NotAlike, proof);
        let mut pose = *initial;
        let mut last = None;
        let level = &self.working.levels[0];
        for (range, max_error_px) in ROUNDS {
            let view = View::draw(&self.eye, level, self.mesh, &pose);
            let matches = view.match_patches(range);
            let (pixels, points): (Vec<Point2<f64>>, Vec<Point3<f64>>) =
                matches.found.iter().map(|m| (m.pixel, m.point_in_world)).unzip();
            // Where a pattern repeats, patches near the last pose agree on a wrong one: all take
            // part in a new choice.
            let options = AbsolutePoseOptions {
                max_error_px,
                min_inliers: MIN_INLIERS,
                max_iterations: MAX_ITERATIONS,
                ..AbsolutePoseOptions::default()
            };
            let chosen = estimate_absolute_pose(&pixels, &points, &level.camera, &options, 0)
                .map_or(pose, |found| found.cam_from_world);
            let refined =
                refine_absolute_pose(&pixels, &points, &level.camera, &chosen, max_error_px)
                    .ok_or_else(|| not_alike(Some(self.proof(&view, &matches))))?;
            pose = refined.cam_from_world;
            last = Some((refined, view, matches));
        }
        let (refined, view, matches) = last.ok_or(not_alike(None))?;
        let proof = self.proof(&view, &matches);
        let camera = &level.camera;
        let located =
            self.located(camera, &refined, &matches, proof).ok_or(not_alike(Some(proof)))?;
        judge(&located, &refined, &matches, camera, prior)
            .map_err(|reason| (reason, Some(proof)))?;
        Ok(located)
    }

    fn proof(&self, view: &View, matches: &PatchMatches) -> TemplateProof {
        TemplateProof { score: view.score(matches), light: Light::measure(self.working, view) }
    }

    /// `None` if the patches leave the pose undetermined.
    fn located(
        &self,
        camera: &Camera,
        refined: &RefinedPose,
        matches: &PatchMatches,
        proof: TemplateProof,
    ) -> Option<Located> {
        let sights: Vec<Sight> = matches.found.iter().map(PatchMatch::sight).collect();
        let weighted = refine_weighted(&sights, camera, &refined.cam_from_world)?;
        let covariance = weighted.covariance + surface_share(&sights, camera, &weighted);
        let pose = weighted.cam_from_world;
        let mut depths: Vec<f64> = sights.iter().map(|sight| (pose * sight.point).z).collect();
        Some(Located {
            cam_from_world: pose,
            median_depth: volery_geometry::median(&mut depths)?,
            estimate: PoseEstimate {
                map_from_camera: pose.inverse(),
                covariance: covariance_in_map(&pose, &covariance),
                num_inliers: refined.num_inliers,
                num_correspondences: matches.num_tried,
                reprojection_px: refined.rms_px * self.original_scale,
                sightings: Vec::new(),
            },
            proof,
        })
    }
}

/// Whether a pose is believed, and if not, why.
fn judge(
    located: &Located,
    refined: &RefinedPose,
    matches: &PatchMatches,
    camera: &Camera,
    prior: &LocalizationPrior,
) -> Result<(), NotFoundReason> {
    let estimate = &located.estimate;
    if located.proof.score.seen < MIN_SEEN {
        return Err(NotFoundReason::NothingInView);
    }
    if estimate.num_inliers < MIN_INLIERS || estimate.inlier_ratio() < MIN_INLIER_RATIO {
        return Err(NotFoundReason::TooFewInliers);
    }
    if located.proof.score.agreement < MIN_AGREEMENT {
        return Err(NotFoundReason::NotAlike);
    }
    let support: Vec<Point2<f64>> = matches
        .found
        .iter()
        .zip(&refined.inliers)
        .filter(|(_, inlier)| **inlier)
        .map(|(patch, _)| patch.pixel)
        .collect();
    if num_cells(&support, camera) < MIN_CELLS {
        return Err(NotFoundReason::PoorSpread);
    }
    let sigma = |row: usize| {
        let block: Matrix3<f64> = estimate.covariance.fixed_view::<3, 3>(row, row).into_owned();
        block.symmetric_eigenvalues().max().max(0.0).sqrt()
    };
    let is_certain = sigma(0) < MAX_RELATIVE_SIGMA * located.median_depth
        && sigma(3) < MAX_SIGMA_DEG.to_radians();
    if !is_certain {
        return Err(NotFoundReason::Uncertain);
    }
    if is_far_from(&estimate.map_from_camera, prior) {
        return Err(NotFoundReason::FarFromPrior);
    }
    Ok(())
}

/// The search starts at the prior; what lies far from it was not searched for.
fn is_far_from(map_from_camera: &Isometry3<f64>, prior: &LocalizationPrior) -> bool {
    let position = prior.position.is_some_and(|(position, sigma)| {
        let error = (Point3::from(map_from_camera.translation.vector) - position).norm();
        error > MAX_PRIOR_SIGMAS * sigma
    });
    let yaw = prior.yaw.is_some_and(|(yaw, sigma)| {
        let forward = map_from_camera.rotation * Vector3::z();
        let turn = forward.y.atan2(forward.x) - yaw;
        forward.xy().norm() > 0.3 && turn.sin().atan2(turn.cos()).abs() > MAX_PRIOR_SIGMAS * sigma
    });
    position || yaw
}
