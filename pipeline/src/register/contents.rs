//! What a merged map takes from its parts.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Similarity3, Vector3};
use rayon::prelude::*;
use volery_features::GlobalDescriptor;
use volery_localization::LocalizationIndex;
use volery_scene::{DESCRIPTOR_LEN, Descriptor, Quality, QualityReason, SparseModel, Verdict};

use super::part::{KeptFeatures, Part};
use crate::map_folder::MapInput;

/// Vertical axes of two maps that differ by more speak against one of them, radians.
const MAX_TILT: f64 = 0.05;
/// Two metric maps whose units differ by more sigmas do not agree on the meter.
const MAX_SCALE_SIGMAS: f64 = 4.0;
/// Scale that two maps may disagree about in any case.
const SCALE_SLACK: f64 = 0.02;

/// Names that are not given yet.
#[derive(Default)]
pub(super) struct Names(BTreeSet<String>);

impl Names {
    /// `name`, or if it is taken, one that begins with the number of its map.
    pub(super) fn give(&mut self, name: &str, number: usize) -> String {
        let mut new = name.to_owned();
        while !self.0.insert(new.clone()) {
            new = format!("{number}/{new}");
        }
        new
    }
}

/// Names of the posed images in order, and all inputs.
pub(super) fn names_and_inputs(
    parts: &[Part],
    poses: &[Option<Similarity3<f64>>],
    names: &mut Names,
) -> (Vec<String>, Vec<MapInput>) {
    let (mut posed, mut inputs) = (Vec::new(), Vec::new());
    for (number, (part, _)) in parts.iter().zip(poses).enumerate().filter(|(_, p)| p.1.is_some()) {
        let own: BTreeSet<&String> = part
            .info
            .inputs
            .iter()
            .map(|input| &input.name)
            .chain(part.map.model.images.values().map(|image| &image.name))
            .collect();
        let renamed: BTreeMap<&String, String> =
            own.into_iter().map(|name| (name, names.give(name, number + 1))).collect();
        posed.extend(part.map.model.images.values().map(|image| renamed[&image.name].clone()));
        inputs.extend(part.info.inputs.iter().map(|input| MapInput {
            name: renamed[&input.name].clone(),
            blake3: input.blake3.clone(),
        }));
    }
    (posed, inputs)
}

/// The worst of the parts, and what they do not agree on.
pub(super) fn quality(parts: &[Part], poses: &[Option<Similarity3<f64>>]) -> Quality {
    let mut quality = parts[0].info.quality.clone();
    let mut doubt = |code: &str, detail: String| {
        quality.verdict = quality.verdict.max(Verdict::Suspect);
        quality.reasons.push(QualityReason { code: code.to_owned(), detail });
    };
    for (part, pose) in parts.iter().zip(poses).skip(1) {
        let Some(frame_from_part) = pose else { continue };
        for reason in &part.info.quality.reasons {
            doubt(&reason.code, format!("{}: {}", part.name, reason.detail));
        }
        let up = frame_from_part.isometry.rotation * Vector3::z();
        let tilt = up.angle(&Vector3::z());
        if tilt > MAX_TILT {
            let detail = format!("{} is tilted by {:.1} degrees", part.name, tilt.to_degrees());
            doubt("gravity_disagreement", detail);
        }
        let (a, b) = (parts[0].info.scale, part.info.scale);
        let sigma = a.sigma_rel.unwrap_or(0.0).hypot(b.sigma_rel.unwrap_or(0.0));
        let off = frame_from_part.scaling().ln().abs();
        if a.metric && b.metric && off > SCALE_SLACK.max(MAX_SCALE_SIGMAS * sigma) {
            let percent = 100.0 * off;
            let detail = format!("the meter of {} differs by {percent:.1} %", part.name);
            doubt("scale_disagreement", detail);
        }
    }
    quality
}

/// What the parts have kept of their images, in the order of the merged model.
pub(super) fn kept_features(
    parts: &[Part],
    poses: &[Option<Similarity3<f64>>],
) -> Vec<KeptFeatures> {
    let joined = parts.iter().zip(poses).filter(|(_, pose)| pose.is_some()).map(|(part, _)| part);
    let joined: Vec<&Part> = joined.collect();
    joined
        .par_iter()
        .flat_map_iter(|part| (0..part.num_images()).map(|image| part.kept_features(image)))
        .collect()
}

/// The localization index of a model, of the keypoints whose descriptors are known.
pub(super) fn index(model: &SparseModel, known: &[KeptFeatures]) -> LocalizationIndex {
    let mut kept = model.clone();
    for (image, features) in kept.images.values_mut().zip(known) {
        for (point, descriptor) in image.points.iter_mut().zip(&features.descriptors) {
            *point = point.filter(|_| descriptor.is_some());
        }
    }
    let SparseModel { images, points, .. } = &mut kept;
    for (id, point) in points.iter_mut() {
        point.track.retain(|o| {
            images.get(&o.image).is_some_and(|image| image.points[o.keypoint as usize] == Some(*id))
        });
    }
    points.retain(|_, point| !point.track.is_empty());
    let descriptors: Vec<Vec<Descriptor>> = known
        .iter()
        .map(|all| all.descriptors.iter().map(|d| d.unwrap_or([0; DESCRIPTOR_LEN])).collect())
        .collect();
    let globals: Vec<GlobalDescriptor> = known.iter().map(|all| all.global.clone()).collect();
    LocalizationIndex::new(&kept, &descriptors, &globals)
}
