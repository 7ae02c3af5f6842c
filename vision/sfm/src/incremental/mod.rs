//! The incremental mapper: a pair, then image after image.

mod bundle;
mod given_poses;
mod initial_pair;
mod loop_closure;
mod next_view;
mod points;
mod projection;
mod re_resection;
mod resection;
pub(crate) mod working;

use volery_estimation::BundleOptions;
use volery_geometry::Camera;
use volery_scene::{Cancelled, Progress, SparseModel, Stage, TwoViewGeometry};

pub(crate) use bundle::{FOV_RANGE_DEG, MAX_DISTORTION};
pub(crate) use given_poses::triangulate_at_given_poses;
pub(crate) use initial_pair::relative_pose;
use initial_pair::{InitialDemands, rank_initial_pairs};
use resection::Support;
pub(crate) use working::{Input, WorkingModel};

use crate::tracks::build_tracks;
use crate::view_graph::components;
use crate::{MapperOptions, SfmCamera, SfmImage};

/// Initial pairs tried per rung of the ladder of demands.
const MAX_INITIAL_PAIRS: usize = 25;
/// Whole models grown from different initial pairs before the largest is taken.
const MAX_ATTEMPTS: usize = 3;
/// Part of the connected images a model must hold for no other start to be tried.
const COMPLETE_FRACTION: f64 = 0.8;
/// A smaller model of left-over images is no zone.
const MIN_ZONE_IMAGES: usize = 3;
/// Fewest points of a zone.
const MIN_ZONE_POINTS: usize = 50;
/// Points an image must see to be tried.
const MIN_VISIBLE: usize = 15;
/// An image that failed is tried again when it sees so many times more points.
const RETRY_GROWTH: f64 = 1.3;
/// Growth in images or points since the last global adjustment that asks for the next.
const GLOBAL_GROWTH: f64 = 1.25;
/// An image that takes part in fewer points loses its pose.
const MIN_IMAGE_POINTS: usize = 12;
/// Global rounds of adjustment and filtering at the end.
const MAX_FINAL_ROUNDS: usize = 5;
/// Scale of the last losses, median errors: 2.4 standard deviations, where Cauchy's loss has 95 %
/// of the efficiency of least squares under normal noise.
const LOSS_MEDIANS: f64 = 2.0;
/// Rounds of looking for the points in further images.
const NUM_SEARCHES: usize = 1;
/// Rounds of placing images anew by what the others see.
const MAX_RE_RESECTIONS: usize = 3;
/// Cost, in logarithms of likelihood, by which a round must help: far beyond what a pose gains by
/// its six freedoms.
const MIN_GAIN: f64 = 10.0;
/// The end: a round changed a smaller part of the sightings.
const STEADY_FRACTION: f64 = 5e-4;
/// The end as well: a round changed more than this part of what the one before it did. Points on the
/// brink of the limits come and go for ever.
const FLICKER_FRACTION: f64 = 0.5;

/// While the model grows every adjustment is followed by others, so none goes to the end.
const LOCAL: BundleOptions =
    BundleOptions { max_iterations: 12, loss_scale_px: Some(1.0), cost_tolerance: 1e-3 };
const GLOBAL: BundleOptions =
    BundleOptions { max_iterations: 15, loss_scale_px: Some(1.0), cost_tolerance: 1e-3 };
const FINAL: BundleOptions =
    BundleOptions { max_iterations: 40, loss_scale_px: Some(1.0), cost_tolerance: 1e-6 };

/// Models of the images, largest first, each in a frame of its own.
///
/// `start` are the intrinsics to begin with, one per camera. Images that no model could take are
/// in none. Deterministic for any number of threads.
///
/// Source: Schönberger & Frahm, "Structure-from-Motion Revisited", CVPR 2016, for the order of the
/// steps: initial pair, next view by spread of visible points, resection, triangulation, local
/// and global adjustment, filtering.
pub fn map_incrementally(
    images: &[SfmImage],
    cameras: &[SfmCamera],
    start: &[Camera],
    pairs: &[TwoViewGeometry],
    options: &MapperOptions,
    progress: &dyn Progress,
) -> Result<Vec<SparseModel>, Cancelled> {
    let input = Input { images, cameras, pairs, options };
    let tracks = build_tracks(images, pairs);
    let mut usable = vec![true; images.len()];
    let mut start = start.to_vec();
    let mut models = Vec::new();
    let mut num_done = 0;
    loop {
        progress.check()?;
        let empty = WorkingModel::new(input, start.clone(), &tracks, usable.clone());
        let Some(model) = largest_model(&empty, num_done, progress)? else { break };
        let is_map = models.is_empty();
        let registered = model.registered();
        for &image in &registered {
            usable[image] = false;
        }
        num_done += registered.len();
        if is_map || (registered.len() >= MIN_ZONE_IMAGES && model.num_points() >= MIN_ZONE_POINTS)
        {
            // What the map taught about a camera holds for the zones too.
            start.clone_from(&model.cameras);
            models.push(model.to_sparse());
        }
        if usable.iter().filter(|&&usable| usable).count() < MIN_ZONE_IMAGES {
            break;
        }
    }
    models.sort_by_key(|model| std::cmp::Reverse(model.images.len()));
    Ok(models)
}

/// The largest of a few models grown from different initial pairs.
fn largest_model<'a>(
    empty: &WorkingModel<'a>,
    num_done: usize,
    progress: &dyn Progress,
) -> Result<Option<WorkingModel<'a>>, Cancelled> {
    let ranked = rank_initial_pairs(empty);
    let connected = components(empty.num_images(), empty.input.pairs, &empty.usable);
    let mut best: Option<WorkingModel<'a>> = None;
    let mut num_attempts = 0;
    for demands in InitialDemands::LADDER {
        for &pair in ranked.iter().take(MAX_INITIAL_PAIRS) {
            let image1 = empty.input.pairs[pair].image1.0 as usize;
            if let Some(best) = &best {
                // A second start inside the model would only build it again.
                let image2 = empty.input.pairs[pair].image2.0 as usize;
                if best.poses[image1].is_some() && best.poses[image2].is_some() {
                    continue;
                }
            }
            progress.check()?;
            let mut model = empty.clone();
            if !model.initialize(pair, demands, progress)? {
                continue;
            }
            model.grow(num_done, progress)?;
            num_attempts += 1;
            let num_reachable = connected[image1]
                .map_or(0, |c| connected.iter().filter(|&&other| other == Some(c)).count());
            let num_registered = model.num_registered();
            let is_complete = num_registered as f64 >= COMPLETE_FRACTION * num_reachable as f64;
            if best.as_ref().is_none_or(|best| num_registered > best.num_registered()) {
                best = Some(model);
            }
            if is_complete || num_attempts >= MAX_ATTEMPTS {
                return Ok(best.filter(|model| model.num_registered() >= 2));
            }
        }
        if best.is_some() {
            break;
        }
    }
    Ok(best.filter(|model| model.num_registered() >= 2))
}

impl WorkingModel<'_> {
    /// Adds images until none fits any more, then refines everything to the end.
    pub(crate) fn grow(
        &mut self,
        num_done: usize,
        progress: &dyn Progress,
    ) -> Result<(), Cancelled> {
        let total = self.num_images();
        let mut failed_at = vec![0usize; total];
        let mut at_last_global = (0, 0);
        let mut support = Support::STRICT;
        loop {
            progress.check()?;
            if let Some(image) = self.register_next(support, &mut failed_at) {
                self.triangulate_image(image);
                let local = self.adjust_around(image, &LOCAL, progress)?;
                self.filter_points_of(&local);
                for &image in &local {
                    self.triangulate_image(image);
                }
                progress.report(
                    Stage::Mapping,
                    (num_done + self.num_registered()).min(total),
                    total,
                );
                support = Support::STRICT;
                let grown = |now: usize, then: usize| now as f64 >= GLOBAL_GROWTH * then as f64;
                if grown(self.num_registered(), at_last_global.0)
                    || grown(self.num_points(), 2 * at_last_global.1)
                {
                    self.refine(&GLOBAL, progress)?;
                    at_last_global = (self.num_registered(), self.num_points());
                }
            } else if at_last_global.0 != self.num_registered() {
                self.refine(&GLOBAL, progress)?;
                at_last_global = (self.num_registered(), self.num_points());
                failed_at.fill(0);
            } else if support == Support::STRICT {
                support = Support::RELAXED;
                failed_at.fill(0);
            } else {
                break;
            }
        }
        self.finish(progress)
    }

    /// Poses the best candidate that can be posed.
    fn register_next(&mut self, support: Support, failed_at: &mut [usize]) -> Option<usize> {
        for candidate in self.next_views(MIN_VISIBLE) {
            let image = candidate.image;
            if (candidate.num_visible as f64) < RETRY_GROWTH * failed_at[image] as f64 {
                continue;
            }
            if let Some(pose) = self.resect(image, support) {
                self.poses[image] = Some(pose);
                return Some(image);
            }
            failed_at[image] = candidate.num_visible;
        }
        None
    }

    /// One global round: close loops, adjust, bring the points up to date.
    fn refine(
        &mut self,
        options: &BundleOptions,
        progress: &dyn Progress,
    ) -> Result<usize, Cancelled> {
        self.close_loops(progress)?;
        self.adjust_all(options, progress)?;
        let num_changed = self.update_tracks();
        self.drop_weak_images();
        Ok(num_changed)
    }

    /// Global rounds until the points are steady.
    pub(crate) fn finish(&mut self, progress: &dyn Progress) -> Result<(), Cancelled> {
        let mut before = self.refine(&GLOBAL, progress)?;
        for _ in 1..MAX_FINAL_ROUNDS {
            let num_changed = self.refine(&GLOBAL, progress)?;
            let num_active: usize = self.tracks.iter().map(|track| track.num_active()).sum();
            let is_steady = num_changed as f64 <= STEADY_FRACTION * num_active as f64;
            let flickers = num_changed as f64 > FLICKER_FRACTION * before as f64;
            if is_steady || flickers {
                break;
            }
            before = num_changed;
        }
        for _ in 0..NUM_SEARCHES {
            self.search_by_projection();
            self.adjust_all(&self.narrowed(&GLOBAL), progress)?;
            self.update_tracks();
        }
        self.adjust_finally(progress)?;
        self.filter_points();
        self.drop_weak_images();
        Ok(())
    }

    /// The last adjustments, each after the first from where images that the others contradict
    /// were placed anew, as long as that lowers the cost by more than chance.
    fn adjust_finally(&mut self, progress: &dyn Progress) -> Result<(), Cancelled> {
        let options = self.narrowed(&FINAL);
        let scale_px = options.loss_scale_px.unwrap_or(1.0);
        self.adjust_all(&options, progress)?;
        for _ in 0..MAX_RE_RESECTIONS {
            let moved = self.poses_by_the_others();
            if moved.is_empty() {
                break;
            }
            let mut anew = self.clone();
            for (image, pose) in moved {
                anew.poses[image] = Some(pose);
            }
            anew.adjust_all(&options, progress)?;
            if anew.robust_cost(scale_px) > self.robust_cost(scale_px) - MIN_GAIN {
                break;
            }
            *self = anew;
        }
        Ok(())
    }

    /// `options` with a loss as narrow as the noise: a wider one lets every slightly wrong match
    /// pull at the poses.
    fn narrowed(&self, options: &BundleOptions) -> BundleOptions {
        let loss_scale_px = self.median_error_px().map(|median| LOSS_MEDIANS * median);
        BundleOptions { loss_scale_px: loss_scale_px.or(options.loss_scale_px), ..*options }
    }

    /// Images with hardly a point left lose their pose.
    fn drop_weak_images(&mut self) {
        for image in self.registered() {
            if self.num_registered() > 2 && self.num_image_points(image) < MIN_IMAGE_POINTS {
                self.remove_image(image);
            }
        }
    }
}

/// Least triangulation angle, radians, when a model is extended: a scan in place has little more.
const MIN_EXTENSION_ANGLE: f64 = 0.5 * std::f64::consts::PI / 180.0;

/// Further images join a model of another mapper, then everything is refined.
pub(crate) fn extend_model(
    input: Input<'_>,
    model: &SparseModel,
    progress: &dyn Progress,
) -> Result<SparseModel, Cancelled> {
    let min_angle = input.options.min_angle.min(MIN_EXTENSION_ANGLE);
    let options = MapperOptions { min_angle, ..*input.options };
    let input = Input { options: &options, ..input };
    let tracks = build_tracks(input.images, input.pairs);
    let start = input.cameras.iter().map(|camera| camera.camera).collect();
    let mut working = WorkingModel::new(input, start, &tracks, vec![true; input.images.len()]);
    working.load(model);
    working.update_tracks();
    working.grow(0, progress)?;
    Ok(working.to_sparse())
}
