//! A merged map before it is written.

use std::{collections::BTreeMap, fs, path::Path};

use nalgebra::Similarity3;
use volery_estimation::BundleError;
use volery_registration::{PointOfPart, adjust_merged, merge_models};
use volery_scene::{EnvironmentMap, Progress, SparseModel, Stage};

use super::{
    contents::{Names, index, kept_features, names_and_inputs, quality},
    pairs::Pair,
    part::{KeptFeatures, Part},
};
use crate::{
    PipelineError,
    error::code,
    export::{bounds, write_files},
    map_folder::{MapInfo, MapInput},
};

/// Photos count as the second map where their names are taken.
const NUMBER_OF_PHOTOS: usize = 2;

/// Maps in one frame, that of the first.
pub(super) struct Whole {
    pub(super) model: SparseModel,
    /// Without what follows from the model.
    pub(super) info: MapInfo,
    /// Of the images in order.
    pub(super) features: Vec<KeptFeatures>,
    /// Those of inputs and images that are taken.
    names: Names,
    /// Points that more than one map knew.
    pub(super) num_shared: usize,
    /// Images whose frame it is.
    num_reference: usize,
}

impl Whole {
    /// Of the parts with a pose; nothing is refined yet.
    pub(super) fn of(
        parts: &[Part],
        pairs: &[Pair],
        used: &[bool],
        poses: &mut [Option<Similarity3<f64>>],
        seed: u64,
    ) -> Self {
        let shared = shared_points(pairs, used, poses);
        let models: Vec<(&SparseModel, Similarity3<f64>)> = parts
            .iter()
            .zip(poses.iter())
            .filter_map(|(part, pose)| Some((&part.map.model, (*pose)?)))
            .collect();
        let mut model = merge_models(&models, &shared);
        let first = &parts[0];
        // A map without a unit takes that of the first one that has it.
        let unit = (0..parts.len()).find(|&i| poses[i].is_some() && parts[i].info.scale.metric);
        let scale = unit.map_or(first.info.scale, |i| parts[i].info.scale);
        let frame_from_unit = unit.and_then(|i| poses[i]);
        if let Some(pose) = frame_from_unit.filter(|_| !first.info.scale.metric) {
            let change = Similarity3::from_scaling(1.0 / pose.scaling());
            model.transform(&change);
            poses.iter_mut().flatten().for_each(|pose| *pose = change * *pose);
        }
        let mut names = Names::default();
        let (posed, inputs) = names_and_inputs(parts, poses, &mut names);
        model.images.values_mut().zip(posed).for_each(|(image, name)| image.name = name);
        let info = MapInfo {
            scale,
            quality: quality(parts, poses),
            num_dense_points: None,
            free_space_voxel: None,
            num_triangles: None,
            map_from_index: None,
            seed,
            inputs,
            ..first.info.clone()
        };
        let num_shared = shared.len();
        let num_reference = first.num_images();
        let features = kept_features(parts, poses);
        Self { model, info, features, names, num_shared, num_reference }
    }

    /// Remembers that a photo goes in, once; returns the name that it has in the map.
    pub(super) fn add_input(&mut self, name: &str, hash: Option<&blake3::Hash>) -> String {
        let blake3 = hash.map_or(String::new(), |hash| hash.to_hex().to_string());
        let known = self.info.inputs.iter().find(|input| input.blake3 == blake3);
        if let Some(known) = known {
            return known.name.clone();
        }
        let name = self.names.give(name, NUMBER_OF_PHOTOS);
        self.info.inputs.push(MapInput { name: name.clone(), blake3 });
        name
    }

    /// Refines all of it together.
    pub(super) fn settle(&mut self, progress: &dyn Progress) -> Result<(), PipelineError> {
        progress.report(Stage::Mapping, 0, 1);
        adjust_merged(&mut self.model, self.num_reference, progress).map_err(
            |error| match error {
                BundleError::Cancelled(cancelled) => cancelled.into(),
                other => PipelineError::plain(code::NO_MODEL, other.to_string()),
            },
        )?;
        progress.report(Stage::Mapping, 1, 1);
        Ok(())
    }

    /// Writes the map folder.
    pub(super) fn write(
        self,
        out_dir: &Path,
        progress: &dyn Progress,
    ) -> Result<(EnvironmentMap, MapInfo), PipelineError> {
        let Self { model, info, features, .. } = self;
        let info = MapInfo {
            cameras: model.cameras.values().map(Into::into).collect(),
            num_images: model.images.len(),
            num_points: model.points.len(),
            bounds: bounds(&model),
            ..info
        };
        fs::create_dir_all(out_dir).map_err(|e| PipelineError::io(out_dir, &e))?;
        let index = index(&model, &features).to_bytes();
        let map = info.map(model);
        write_files(&map, &info, &index, out_dir, progress)?;
        Ok((map, info))
    }
}

/// Pairs of points that are the same; parts are counted among those with a pose.
fn shared_points(
    pairs: &[Pair],
    used: &[bool],
    poses: &[Option<Similarity3<f64>>],
) -> Vec<(PointOfPart, PointOfPart)> {
    let joined = (0..poses.len()).filter(|&i| poses[i].is_some());
    let place: BTreeMap<usize, usize> = joined.zip(0..).collect();
    let mut shared = Vec::new();
    for (pair, _) in pairs.iter().zip(used).filter(|(_, used)| **used) {
        let (Some(&s), Some(&t)) = (place.get(&pair.source), place.get(&pair.target)) else {
            continue;
        };
        let found = pair.found.iter().flat_map(|found| &found.points);
        shared.extend(found.map(|&(source, target)| ((t, target), (s, source))));
    }
    shared
}
