//! What came of a registration: the content of `report.json`.

use std::collections::BTreeSet;

use nalgebra::Similarity3;
use serde::{Deserialize, Serialize};
use volery_scene::{PointId, Quality, RegisteredImage};

use super::{
    pairs::{Found, Pair},
    part::Part,
};
use crate::{
    PipelineError,
    summary::{DenseSummary, MeshSummary},
};

/// Where a map lies in the merged one.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MapReport {
    /// As given.
    pub name: String,
    /// Whether it is part of the merged map.
    pub joined: bool,
    /// Quaternion w, x, y, z of `merged_from_map`.
    pub rotation: [f64; 4],
    /// Of `merged_from_map`.
    pub translation: [f64; 3],
    /// Of `merged_from_map`.
    pub scale: f64,
    /// Its images.
    pub num_images: usize,
}

/// What brings two maps together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FoundBy {
    /// Points that look the same.
    Points,
    /// The shape of the surfaces.
    Surfaces,
}

/// What two maps say about each other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PairReport {
    /// Name of the map that was moved.
    pub source: String,
    /// Name of the map onto which.
    pub target: String,
    /// Points that look the same.
    pub num_pairs: usize,
    /// Points of these that the transform brings together.
    pub num_inliers: usize,
    /// Their share; by surfaces, the share of the smaller surface that lies on the other. 0 to 1.
    pub fitness: f64,
    /// Share of the images of the smaller map that see such a point; by surfaces, as `fitness`.
    pub overlap: f64,
    /// What the transform was found by.
    #[serde(default)]
    pub by: Option<FoundBy>,
    /// Steps of the last search over the surfaces.
    #[serde(default)]
    pub iterations: Option<usize>,
    /// Share of what both surfaces should see that speaks against it, 0 to 1.
    #[serde(default)]
    pub contradiction: Option<f64>,
    /// Root mean square distance of what is brought together, units of the target.
    pub rms: Option<f64>,
    /// Scale of the target relative to the source.
    pub scale: Option<f64>,
    /// Whether the merged map rests on it.
    pub used: bool,
    /// Why there is no transform.
    pub error: Option<PipelineError>,
}

/// What became of a photo that was to join a map.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PhotoReport {
    /// As given.
    pub name: String,
    /// Whether it has a pose in the map now that it had not before.
    pub joined: bool,
    /// Why not, a stable code: `already_in_map`, `repeated`, what is wrong with its bytes, or as in
    /// the answer to a photo that was not found.
    pub reason: Option<String>,
    /// The photo of the same content, in the map or among the given ones.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub same_as: Option<String>,
}

impl PhotoReport {
    /// Whether it should have joined and did not.
    fn is_left_out(&self) -> bool {
        !self.joined && self.same_as.is_none()
    }

    /// Photos by what kept them from joining.
    pub(super) fn told(photos: &[Self]) -> String {
        let told: Vec<String> = photos
            .iter()
            .filter(|photo| !photo.joined)
            .take(MAX_TOLD)
            .map(|photo| format!("{} {}", photo.name, photo.reason.as_deref().unwrap_or_default()))
            .collect();
        let rest = photos.iter().filter(|photo| !photo.joined).count() - told.len();
        let and = if rest > 0 { format!(" and {rest} more") } else { String::new() };
        told.join(", ") + &and
    }
}

/// Photos that an error names one by one.
const MAX_TOLD: usize = 5;

/// The maps and every pair of them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RegisterReport {
    /// In the order given; the first is the reference.
    pub maps: Vec<MapReport>,
    /// Every pair.
    pub pairs: Vec<PairReport>,
    /// Those that were to join, in the order given.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub photos: Vec<PhotoReport>,
    /// Points that more than one map knew.
    pub num_shared_points: usize,
    /// Points of the merged map.
    pub num_points: usize,
    /// Mean reprojection error after all was refined together, pixels.
    pub reprojection_px: Option<f64>,
    /// How far to trust the merged map.
    pub quality: Quality,
    /// Images whose photo is not there any more: the surface is made without them.
    #[serde(default)]
    pub num_photos_gone: usize,
    /// Of the dense cloud, if one was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dense: Option<DenseSummary>,
    /// Of the mesh, if one was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mesh: Option<MeshSummary>,
}

impl RegisterReport {
    /// What the merged map lacks first; `None` where every map, or nine of ten photos, became a part
    /// of a good one.
    pub fn lack(&self) -> Option<PipelineError> {
        let num_left_out = self.photos.iter().filter(|photo| photo.is_left_out()).count();
        let num_given = self.photos.iter().filter(|photo| photo.same_as.is_none()).count();
        if num_left_out * 10 > num_given {
            let told = PhotoReport::told(&self.photos);
            let detail = format!("{num_left_out} of {num_given} new photos did not join: {told}");
            let hint = "take photos that show what photos of the map show";
            return Some(PipelineError::new("images_unplaced", detail, hint));
        }
        // Photos that are no map of their own may have joined one by one.
        let maps = self.maps.iter().filter(|_| self.photos.is_empty());
        if let Some(map) = maps.into_iter().find(|map| !map.joined) {
            let about = |pair: &&PairReport| pair.source == map.name || pair.target == map.name;
            let error = self.pairs.iter().filter(about).find_map(|pair| pair.error.as_ref());
            let why = error.map_or(String::new(), |error| format!(": {}", error.detail));
            return Some(PipelineError::new(
                "maps_unjoined",
                format!("{} was left out{why}", map.name),
                "extend one of the maps with photos that show what both show",
            ));
        }
        if let Some(reason) = self.quality.reasons.first() {
            return Some(PipelineError::plain(&reason.code, reason.detail.clone()));
        }
        let dense = self.dense.as_ref().and_then(|dense| dense.error.as_ref());
        let surface = dense.or_else(|| self.mesh.as_ref()?.error.as_ref()).cloned();
        let gone = self.num_photos_gone;
        surface.or_else(|| {
            let detail = format!("the surface lacks {gone} photos that are gone");
            (gone > 0).then(|| PipelineError::plain("photos_gone", detail))
        })
    }
}

pub(super) fn map_report(part: &Part, pose: &Option<Similarity3<f64>>) -> MapReport {
    let motion = pose.unwrap_or_else(Similarity3::identity);
    let q = motion.isometry.rotation;
    MapReport {
        name: part.name.clone(),
        joined: pose.is_some(),
        rotation: [q.w, q.i, q.j, q.k],
        translation: motion.isometry.translation.vector.into(),
        scale: motion.scaling(),
        num_images: part.num_images(),
    }
}

pub(super) fn pair_report(parts: &[Part], pair: &Pair, used: bool) -> PairReport {
    let (source, target) = (&parts[pair.source], &parts[pair.target]);
    let found = pair.found.as_ref().ok();
    let num_pairs = found.map_or(0, |found| found.num_pairs);
    let num_inliers = found.map_or(0, |found| found.points.len());
    let seen = |part: &Part, ids: BTreeSet<PointId>| {
        let sees =
            |image: &&RegisteredImage| image.points.iter().flatten().any(|id| ids.contains(id));
        let num = part.map.model.images.values().filter(sees).count();
        num as f64 / part.num_images().max(1) as f64
    };
    let overlap = found.map_or(0.0, |found| {
        let from = seen(source, found.points.iter().map(|p| p.0).collect());
        from.max(seen(target, found.points.iter().map(|p| p.1).collect()))
    });
    let surfaces = found.and_then(|found| found.surfaces);
    let fitness = num_inliers as f64 / num_pairs.max(1) as f64;
    let by_surfaces = surfaces.map(|(overlap, _)| overlap.fraction);
    let by = |found: &Found| match found.surfaces {
        Some(_) => FoundBy::Surfaces,
        None => FoundBy::Points,
    };
    PairReport {
        source: source.name.clone(),
        target: target.name.clone(),
        num_pairs,
        num_inliers,
        fitness: by_surfaces.unwrap_or(fitness),
        overlap: by_surfaces.unwrap_or(overlap),
        by: found.map(by),
        iterations: surfaces.map(|(_, iterations)| iterations),
        contradiction: surfaces.map(|(overlap, _)| overlap.contradiction),
        rms: found.map(|found| found.rms),
        scale: found.map(|found| found.target_from_source.scaling()),
        used,
        error: pair.found.as_ref().err().cloned(),
    }
}
