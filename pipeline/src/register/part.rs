//! A map as one part of a larger one.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use nalgebra::{Point3, Similarity3};
use volery_features::{GlobalDescriptor, MatchOptions, match_features};
use volery_geometry::KdTree;
use volery_localization::LocalizationIndex;
use volery_registration::CrossMatches;
use volery_scene::{Descriptor, EnvironmentMap, FeatureMatch, ImageId, PointId, SparseModel};

use crate::{
    PipelineError,
    error::code,
    map_folder::{MapInfo, file, read_map},
};

/// Images of the other map that an image is matched with, the most similar ones.
const NUM_SIMILAR: usize = 5;
/// A point of the index is one of the model if it lies this near, as a share of the extent: the
/// frame of the index may have been turned into that of the map.
const SAME_POINT: f64 = 1e-6;

/// What a map keeps of the features of an image.
#[derive(Clone)]
pub(super) struct KeptFeatures {
    /// One per keypoint; `None` where it was not kept.
    pub(super) descriptors: Vec<Option<Descriptor>>,
    /// Of the whole image.
    pub(super) global: GlobalDescriptor,
}

/// A map folder in memory.
pub(super) struct Part {
    pub(super) name: String,
    pub(super) folder: PathBuf,
    pub(super) info: MapInfo,
    pub(super) map: EnvironmentMap,
    pub(super) index: LocalizationIndex,
    /// Images of the model in the order of the index.
    images: Vec<ImageId>,
    /// Keypoint of each row of each image of the index.
    keypoints: Vec<Vec<Option<u32>>>,
}

impl Part {
    pub(super) fn open(name: &str, folder: &Path) -> Result<Self, PipelineError> {
        let (info, map) = read_map(folder)?;
        let path = folder.join(file::LOCALIZATION);
        let bytes = fs::read(&path).map_err(|e| PipelineError::io(&path, &e))?;
        let bad =
            |detail: String| PipelineError::new(code::BAD_MAP, detail, "reconstruct the map again");
        let index = LocalizationIndex::from_bytes(&bytes)
            .map_err(|e| bad(format!("{}: {e}", path.display())))?;
        if index.num_images() != map.model.images.len() {
            return Err(bad(format!("{}: not of this model", path.display())));
        }
        let images = map.model.images.keys().copied().collect();
        let keypoints = keypoints(&info, &map, &index);
        let (name, folder) = (name.to_owned(), folder.to_owned());
        Ok(Self { name, folder, info, map, index, images, keypoints })
    }

    /// Keypoints with points that look like some of `target`, image by image.
    pub(super) fn matches_with(&self, target: &Self) -> Vec<CrossMatches> {
        let mut found = Vec::new();
        for (own, image) in self.images.iter().enumerate() {
            let Some(rows) = self.index.image_rows(own) else { continue };
            let others = (0..target.images.len()).filter_map(|i| {
                let similarity = rows.global.similarity(target.index.image_rows(i)?.global);
                Some((similarity, i))
            });
            let mut others: Vec<(f32, usize)> = others.collect();
            others.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            for &(_, other) in others.iter().take(NUM_SIMILAR) {
                let Some(other_rows) = target.index.image_rows(other) else { continue };
                let matches =
                    match_features(rows.packed, other_rows.packed, &MatchOptions::default());
                let keypoint = |part: &Self, image: usize, row: u32| {
                    part.keypoints[image].get(row as usize).copied().flatten()
                };
                let of_keypoints = matches.iter().filter_map(|m| {
                    let feature1 = keypoint(self, own, m.feature1)?;
                    let feature2 = keypoint(target, other, m.feature2)?;
                    Some(FeatureMatch { feature1, feature2 })
                });
                let matches = of_keypoints.collect();
                found.push(CrossMatches { source: *image, target: target.images[other], matches });
            }
        }
        found
    }

    /// What is known of the keypoints of the image at a position.
    pub(super) fn kept_features(&self, image: usize) -> KeptFeatures {
        let id = self.images[image];
        let mut descriptors = vec![None; self.map.model.images[&id].keypoints.len()];
        let Some(rows) = self.index.image_rows(image) else {
            return KeptFeatures { descriptors, global: GlobalDescriptor(Vec::new()) };
        };
        for (keypoint, descriptor) in self.keypoints[image].iter().zip(rows.descriptors) {
            if let Some(slot) = keypoint.and_then(|k| descriptors.get_mut(k as usize)) {
                *slot = Some(*descriptor);
            }
        }
        KeptFeatures { descriptors, global: rows.global.clone() }
    }

    /// Whether its surface can be laid on that of another map.
    pub(super) fn has_surface(&self) -> bool {
        self.info.num_dense_points.is_some() && self.info.scale.metric
    }

    pub(super) fn num_images(&self) -> usize {
        self.images.len()
    }
}

/// The points of a model that those of its index are: it numbers them anew, and keeps positions.
pub(super) fn points_of_index(
    index: &LocalizationIndex,
    model: &SparseModel,
    map_from_index: &Similarity3<f64>,
) -> Vec<Option<PointId>> {
    let ids: Vec<PointId> = model.points.keys().copied().collect();
    let positions: Vec<Point3<f64>> = model.points.values().map(|p| p.position).collect();
    let extent = positions.iter().map(|p| p.coords.norm()).fold(0.0, f64::max);
    let tree = KdTree::new(&positions);
    (0..index.num_points() as u32)
        .map(|point| {
            let at = map_from_index * index.position(point)?;
            let near = tree.nearest_within(&at, SAME_POINT * extent)?;
            Some(ids[near.index as usize])
        })
        .collect()
}

/// The keypoints of the rows of the index.
fn keypoints(
    info: &MapInfo,
    map: &EnvironmentMap,
    index: &LocalizationIndex,
) -> Vec<Vec<Option<u32>>> {
    let map_from_index =
        info.map_from_index.as_ref().map_or(Similarity3::identity(), |moved| moved.similarity());
    let point_ids = points_of_index(index, &map.model, &map_from_index);
    map.model
        .images
        .values()
        .enumerate()
        .map(|(position, image)| {
            let of_point: BTreeMap<PointId, u32> =
                image.points.iter().zip(0..).filter_map(|(id, k)| Some(((*id)?, k))).collect();
            let rows = index.image_rows(position).map_or(&[][..], |rows| rows.points);
            let keypoint = |point: &u32| {
                of_point.get(&point_ids.get(*point as usize).copied().flatten()?).copied()
            };
            rows.iter().map(keypoint).collect()
        })
        .collect()
}
