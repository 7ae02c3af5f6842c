//! Places that look alike and were taken for one.
//!
//! A map that folds opposite walls onto each other contradicts none of its matches: all that is
//! the same on both walls fits. What differs tells. Two images that the map puts in one spot see
//! the same surfaces, so they should share as many of their points as any two images that close;
//! images of two places share only what looks alike. Keypoints that are missed by chance, or
//! because it is dark or blurred, are missed in near and far views alike, so an image is compared
//! with itself only: what it shares with its nearest view, and with the one it shares most with.
//!
//! Source of the idea: Zach, Irschara, Bischof, "What Can Missing Correspondences Tell Us About
//! 3D Structure and Motion?", CVPR 2008.

use std::collections::BTreeSet;

use nalgebra::{Point3, Vector3};
use volery_geometry::Camera;
use volery_scene::{PointId, RegisteredImage, SparseModel};

/// Most points of an image that are looked for in others.
const MAX_POINTS: usize = 400;
/// Fewest such points in view of another image that make a fraction.
const MIN_VISIBLE: usize = 20;
/// Part of the points of either image that two similar views have in view.
const MIN_OVERLAP: f64 = 0.6;
/// Difference of the directions, radians, and of the logarithms of the distances from which
/// similar views see a point; SIFT bears both.
const MAX_CHANGE: f64 = 0.3;
/// An image that shares a smaller part with its nearest view than with another by this factor
/// does not show what that one shows.
const MIN_SHARED_RATIO: f64 = 0.8;

/// Images with similar views, and those of them that do not show what their nearest view shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Strangers {
    /// Images that could be compared.
    pub num_compared: usize,
    /// Those that share less with the nearest view than with others.
    pub num_strangers: usize,
}

impl Strangers {
    /// Compares every image of `model` with the similar views.
    pub fn of(model: &SparseModel) -> Self {
        let views: Vec<View<'_>> =
            model.images.values().filter_map(|image| View::new(model, image)).collect();
        let ratios: Vec<f64> = (0..views.len()).filter_map(|i| shared_ratio(&views, i)).collect();
        let num_strangers = ratios.iter().filter(|&&ratio| ratio < MIN_SHARED_RATIO).count();
        Self { num_compared: ratios.len(), num_strangers }
    }

    /// Part of the images compared.
    pub fn fraction(&self) -> f64 {
        self.num_strangers as f64 / self.num_compared.max(1) as f64
    }
}

/// An image with what it takes to compare it.
struct View<'a> {
    image: &'a RegisteredImage,
    camera: &'a Camera,
    center: Point3<f64>,
    axis: Vector3<f64>,
    /// Mean distance of its points.
    distance: f64,
    /// A sample of its points in three or more images: those that can be found again.
    points: Vec<(PointId, Point3<f64>)>,
    seen: BTreeSet<PointId>,
}

impl<'a> View<'a> {
    fn new(model: &'a SparseModel, image: &'a RegisteredImage) -> Option<Self> {
        let seen: BTreeSet<PointId> = image.points.iter().flatten().copied().collect();
        let lasting = |id: &PointId| {
            model.points.get(id).filter(|p| p.track.len() >= 3).map(|p| (*id, p.position))
        };
        let all: Vec<_> = seen.iter().filter_map(lasting).collect();
        let points: Vec<_> =
            all.iter().step_by(all.len().div_ceil(MAX_POINTS).max(1)).copied().collect();
        let center = image.center();
        let distance = points.iter().map(|(_, x)| (x - center).norm()).sum::<f64>();
        (points.len() >= MIN_VISIBLE).then(|| Self {
            image,
            camera: &model.cameras[&image.camera],
            center,
            axis: image.cam_from_world.rotation.inverse() * Vector3::z(),
            distance: distance / points.len() as f64,
            points,
            seen,
        })
    }

    /// Points of this view that `other` has in view, from a similar side.
    fn visible_in(&self, other: &View<'_>) -> Vec<PointId> {
        let in_view = |x: &Point3<f64>| {
            let (ray, other_ray) = (x - self.center, x - other.center);
            let norms = ray.norm() * other_ray.norm();
            ray.dot(&other_ray) > MAX_CHANGE.cos() * norms
                && (ray.norm() / other_ray.norm()).ln().abs() < MAX_CHANGE
                && other
                    .camera
                    .project(&(other.image.cam_from_world * x))
                    .is_some_and(|pixel| other.camera.contains(&pixel))
        };
        self.points.iter().filter(|(_, x)| in_view(x)).map(|(id, _)| *id).collect()
    }

    /// `num_visible` as a part of the points of this view.
    fn part(&self, num_visible: usize) -> f64 {
        num_visible as f64 / self.points.len() as f64
    }

    /// Whether it is worth asking more closely.
    fn is_near(&self, other: &View<'_>) -> bool {
        (self.center - other.center).norm() < self.distance && self.axis.dot(&other.axis) > 0.7
    }
}

/// What view `i` shares with the view nearest to it, as a part of the most that it shares with
/// any similar view; `None` without two similar views.
fn shared_ratio(views: &[View<'_>], i: usize) -> Option<f64> {
    let view = &views[i];
    let similar: Vec<(f64, f64)> = views
        .iter()
        .enumerate()
        .filter(|&(j, other)| j != i && view.is_near(other))
        .filter_map(|(_, other)| {
            let visible = view.visible_in(other);
            if visible.len() < MIN_VISIBLE || view.part(visible.len()) <= MIN_OVERLAP {
                return None;
            }
            let overlap = view.part(visible.len()).min(other.part(other.visible_in(view).len()));
            let num_shared = visible.iter().filter(|id| other.seen.contains(id)).count();
            (overlap > MIN_OVERLAP).then(|| (overlap, num_shared as f64 / visible.len() as f64))
        })
        .collect();
    let nearest = similar.iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
    let most = similar.iter().map(|(_, shared)| *shared).fold(0.0, f64::max);
    (similar.len() >= 2 && most > 0.0).then(|| nearest.1 / most)
}
