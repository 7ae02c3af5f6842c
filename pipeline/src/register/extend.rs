//! Photos join a map.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use volery_api::Registration;
use volery_scene::Stage;

use super::{
    Frame, MapSource, PhotoReport, RegisterReport, finish,
    newcomers::{Newcomer, place_newcomers},
    part::Part,
    whole::Whole,
};
use crate::{
    JobSpec, PipelineError, StageGroup, StageProgress,
    cache::Cache,
    error::code,
    ingest::{Fate, Ingested, ingest},
    options::StageOptions,
    reconstruct,
};

/// Fewer photos see too little of one another to be a map of their own.
const MIN_PHOTOS_OF_A_MAP: usize = 5;

/// Photos of `spec` join a map, which is written anew to `out_dir`.
///
/// Photos that are in the map already, by their content, are left alone. The others become a map
/// of their own in `new_dir` that is joined as in [`crate::register_maps`]; those that this leaves
/// over, and all if they are few or nothing comes of it, are looked for in the map one by one. Then
/// everything is refined together.
///
/// # Errors
///
/// [`PipelineError`] with the code `nothing_new` where every photo is in the map already,
/// `no_overlap` where none of the others joins, and for files that cannot be read or written.
pub fn extend_map(
    map: &MapSource,
    spec: &JobSpec,
    work_dir: &Path,
    new_dir: &Path,
    out_dir: &Path,
    progress: &dyn StageProgress,
) -> Result<RegisterReport, PipelineError> {
    let mut parts = vec![Part::open(&map.name, &map.folder)?];
    let options = StageOptions::of(spec);
    let ingested = ingest(spec, &options, &Cache::open(work_dir, Stage::Features)?, progress)?;
    let mut photos = PhotoList::new(&parts[0], spec, &ingested);
    if photos.fresh.is_empty() {
        return Err(photos.nothing_new());
    }
    if photos.fresh.len() >= MIN_PHOTOS_OF_A_MAP {
        match reconstruct(&photos.own_map(spec), work_dir, new_dir, progress) {
            Ok(_) => parts.push(Part::open("new photos", new_dir)?),
            Err(error) if error.is_cancelled() => return Err(error),
            // What went wrong among them says nothing of what each sees of the map.
            Err(_) => {}
        }
    }
    let mut found = Frame::of(&parts, &Registration::default(), spec.seed, progress)?;
    let mut whole = Whole::of(&parts, &found.pairs, &found.used, &mut found.poses, spec.seed);
    if let (Some(Some(_)), Some(new)) = (found.poses.get(1), parts.get(1)) {
        photos.take_out_those_of(new);
        whole.settle(progress)?;
    }
    let newcomers: Vec<Newcomer<'_>> = photos
        .fresh
        .iter()
        .map(|&photo| {
            let usable = &ingested.usable[photo];
            let image = &spec.images[usable.input];
            let name = whole.add_input(&image.name, ingested.hashes[usable.input].as_ref());
            let camera = image.camera.as_ref().or(spec.camera.as_ref());
            Newcomer { name, photo: &usable.photo, camera }
        })
        .collect();
    let outcomes = place_newcomers(&mut whole, &newcomers, spec.seed, progress)?;
    for (&photo, outcome) in photos.fresh.iter().zip(outcomes) {
        let report = &mut photos.reports[ingested.usable[photo].input];
        report.joined = outcome.is_ok();
        report.reason = outcome.err().map(str::to_owned);
    }
    if photos.reports.iter().all(|report| !report.joined) {
        return Err(photos.none_joined());
    }
    whole.settle(progress)?;
    let files = map.photos.iter().chain(spec.images.iter().map(|image| &image.path)).cloned();
    let report = found.report(&parts, &whole, photos.reports);
    finish(spec, report, whole, &files.collect::<Vec<_>>(), [work_dir, out_dir], progress)
}

/// What becomes of the photos.
struct PhotoList {
    /// One per input.
    reports: Vec<PhotoReport>,
    /// Usable photos that are still to join.
    fresh: Vec<usize>,
}

impl PhotoList {
    fn new(map: &Part, spec: &JobSpec, ingested: &Ingested) -> Self {
        let posed: BTreeSet<&str> =
            map.map.model.images.values().map(|image| image.name.as_str()).collect();
        let placed: BTreeMap<&str, &str> = map
            .info
            .inputs
            .iter()
            .filter(|input| posed.contains(input.name.as_str()))
            .map(|input| (input.blake3.as_str(), input.name.as_str()))
            .collect();
        let mut fresh = Vec::new();
        let reports = spec.images.iter().zip(&ingested.fates).zip(&ingested.hashes);
        let reports = reports.map(|((image, fate), hash)| {
            let hash = hash.map(|hash| hash.to_hex());
            let same = hash.as_ref().and_then(|hash| placed.get(hash.as_str()));
            let (reason, same_as) = match (same, fate) {
                (Some(name), _) => (Some("already_in_map"), Some((*name).to_owned())),
                (None, Fate::Usable(photo)) => {
                    fresh.push(*photo);
                    (None, None)
                }
                (None, Fate::DuplicateOf(i)) => {
                    (Some("repeated"), Some(spec.images[*i].name.clone()))
                }
                (None, Fate::Unreadable(code, _)) => (Some(*code), None),
            };
            let reason = reason.map(str::to_owned);
            PhotoReport { name: image.name.clone(), joined: false, reason, same_as }
        });
        let reports = reports.collect();
        Self { reports, fresh }
    }

    /// The job of the fresh photos alone.
    fn own_map(&self, spec: &JobSpec) -> JobSpec {
        let is_fresh = |i: &usize| self.reports[*i].reason.is_none();
        let images: Vec<_> =
            (0..spec.images.len()).filter(is_fresh).map(|i| spec.images[i].clone()).collect();
        let names: BTreeSet<&str> = images.iter().map(|image| image.name.as_str()).collect();
        let mut known_distances = spec.known_distances.clone();
        known_distances.retain(|d| [&d.image_a, &d.image_b].iter().all(|n| names.contains(&***n)));
        JobSpec { images, known_distances, stages: vec![StageGroup::Sfm], ..spec.clone() }
    }

    /// Photos that joined as a map of their own.
    fn take_out_those_of(&mut self, new: &Part) {
        let posed: BTreeSet<&str> =
            new.map.model.images.values().map(|image| image.name.as_str()).collect();
        for report in self.reports.iter_mut().filter(|report| report.reason.is_none()) {
            report.joined = posed.contains(report.name.as_str());
        }
        let mut fresh_reports = self.reports.iter().filter(|report| report.reason.is_none());
        self.fresh.retain(|_| fresh_reports.next().is_some_and(|report| !report.joined));
    }

    fn nothing_new(&self) -> PipelineError {
        PipelineError::new(
            "nothing_new",
            format!("none of {} photos is new: {}", self.reports.len(), self.told()),
            "give photos that are not in the map yet",
        )
    }

    fn none_joined(&self) -> PipelineError {
        PipelineError::new(
            code::NO_OVERLAP,
            format!("no photo joined the map: {}", self.told()),
            "take photos that show what photos of the map show",
        )
    }

    fn told(&self) -> String {
        PhotoReport::told(&self.reports)
    }
}
