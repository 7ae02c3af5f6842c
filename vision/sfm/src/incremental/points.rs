//! Points of the growing model: made, continued, completed, split, filtered.

use nalgebra::Point3;

use super::working::{Sighting, WorkingModel};
use crate::triangulation::{View, triangulate_track};

/// Sightings a remainder of a track needs to become a point of its own.
const MIN_SPLIT_VIEWS: usize = 3;

/// What a look at one track came to.
struct Triangulation {
    track: usize,
    position: Point3<f64>,
    /// Active sightings, by position.
    active: Vec<bool>,
}

impl WorkingModel<'_> {
    /// Continues the points that `image` sees and makes new ones of its tracks. Returns how many
    /// sightings joined.
    pub(crate) fn triangulate_image(&mut self, image: usize) -> usize {
        let mut num_joined = 0;
        let mut fresh = Vec::new();
        for &(track, slot) in &self.image_tracks[image].clone() {
            let (track, slot) = (track as usize, slot as usize);
            let sighting = self.tracks[track].sightings[slot];
            if sighting.active {
                continue;
            }
            match self.tracks[track].position {
                Some(point) => {
                    if self.reprojection_error(&sighting, &point) <= self.input.options.max_error_px
                    {
                        self.tracks[track].sightings[slot].active = true;
                        num_joined += 1;
                    }
                }
                None => fresh.push(track),
            }
        }
        num_joined + self.triangulate_tracks(&fresh)
    }

    /// Makes points of tracks that have none. Returns how many sightings joined.
    pub(crate) fn triangulate_tracks(&mut self, tracks: &[usize]) -> usize {
        use rayon::prelude::*;
        let this = &*self;
        let found: Vec<Triangulation> = tracks
            .par_iter()
            .with_min_len(64)
            .filter_map(|&track| this.triangulate(track, |_| true))
            .collect();
        found.into_iter().map(|t| self.apply(t)).sum()
    }

    /// Goes over all tracks: makes missing points, lets fitting sightings join, drops those that do
    /// not fit, splits off remainders that agree on another point, and drops points with too few
    /// sightings or too small an angle. Returns the number of changed sightings.
    pub(crate) fn update_tracks(&mut self) -> usize {
        let mut num_changed = self.complete_tracks(self.input.options.max_error_px);
        num_changed += self.filter_points();
        let missing: Vec<usize> =
            (0..self.tracks.len()).filter(|&t| self.tracks[t].position.is_none()).collect();
        num_changed += self.triangulate_tracks(&missing);
        num_changed + self.split_tracks()
    }

    /// Lets every sighting of a posed image join that lies within `max_error_px` of its point.
    pub(crate) fn complete_tracks(&mut self, max_error_px: f64) -> usize {
        let mut num_joined = 0;
        for track in 0..self.tracks.len() {
            let Some(point) = self.tracks[track].position else { continue };
            for slot in 0..self.tracks[track].sightings.len() {
                let sighting = self.tracks[track].sightings[slot];
                if !sighting.active && self.reprojection_error(&sighting, &point) <= max_error_px {
                    self.tracks[track].sightings[slot].active = true;
                    num_joined += 1;
                }
            }
        }
        num_joined
    }

    /// Drops sightings beyond the error limit, then points without two sightings or the least
    /// angle. Returns how many sightings went.
    pub(crate) fn filter_points(&mut self) -> usize {
        let all: Vec<usize> = (0..self.tracks.len()).collect();
        self.filter(&all)
    }

    /// [`Self::filter_points`] over the tracks of some images.
    pub(crate) fn filter_points_of(&mut self, images: &[usize]) -> usize {
        let mut tracks: Vec<usize> = images
            .iter()
            .flat_map(|&image| self.image_tracks[image].iter().map(|&(track, _)| track as usize))
            .collect();
        tracks.sort_unstable();
        tracks.dedup();
        self.filter(&tracks)
    }

    fn filter(&mut self, tracks: &[usize]) -> usize {
        let (max_error_px, min_angle) =
            (self.input.options.max_error_px, self.input.options.min_angle);
        let mut num_dropped = 0;
        for &index in tracks {
            let Some(point) = self.tracks[index].position else { continue };
            for slot in 0..self.tracks[index].sightings.len() {
                let sighting = self.tracks[index].sightings[slot];
                if sighting.active && self.reprojection_error(&sighting, &point) > max_error_px {
                    self.tracks[index].sightings[slot].active = false;
                    num_dropped += 1;
                }
            }
            let track = &self.tracks[index];
            let num_active = track.num_active();
            if num_active < 2 || !self.is_well_seen(track, &point, min_angle) {
                num_dropped += num_active;
                self.tracks[index].clear();
            }
        }
        num_dropped
    }

    /// Sightings that were left out of their point and agree on another one become a track of
    /// their own.
    fn split_tracks(&mut self) -> usize {
        let mut num_joined = 0;
        for track in 0..self.tracks.len() {
            if self.tracks[track].position.is_none() {
                continue;
            }
            let num_left = self.tracks[track]
                .sightings
                .iter()
                .filter(|s| !s.active && self.poses[s.image as usize].is_some())
                .count();
            if num_left < MIN_SPLIT_VIEWS {
                continue;
            }
            let Some(rest) = self.triangulate(track, |sighting| !sighting.active) else { continue };
            if rest.active.iter().filter(|&&active| active).count() < MIN_SPLIT_VIEWS {
                continue;
            }
            num_joined += self.split(track, rest);
        }
        num_joined
    }

    /// Moves the sightings of `rest` from `track` to a new track.
    fn split(&mut self, track: usize, rest: Triangulation) -> usize {
        let old = std::mem::take(&mut self.tracks[track].sightings);
        for sighting in &old {
            self.image_tracks[sighting.image as usize].retain(|&(t, _)| t as usize != track);
        }
        let (moved, kept): (Vec<_>, Vec<_>) =
            old.into_iter().zip(&rest.active).partition(|(_, moves)| **moves);
        let unzip = |list: Vec<(Sighting, &bool)>| list.into_iter().map(|(s, _)| s).collect();
        let (mut moved, kept): (Vec<Sighting>, Vec<Sighting>) = (unzip(moved), unzip(kept));
        for (slot, sighting) in kept.iter().enumerate() {
            self.image_tracks[sighting.image as usize].push((track as u32, slot as u32));
        }
        self.tracks[track].sightings = kept;
        for sighting in &mut moved {
            sighting.active = true;
        }
        let num_moved = moved.len();
        let new = self.add_track(moved);
        self.tracks[new].position = Some(rest.position);
        num_moved
    }

    /// Robust point of the sightings of posed images that `candidate` admits.
    fn triangulate(
        &self,
        track: usize,
        candidate: impl Fn(&Sighting) -> bool,
    ) -> Option<Triangulation> {
        let sightings = &self.tracks[track].sightings;
        let mut slots = Vec::with_capacity(sightings.len());
        let mut views: Vec<View> = Vec::with_capacity(sightings.len());
        for (slot, sighting) in sightings.iter().enumerate() {
            if candidate(sighting)
                && let Some(view) = self.view(sighting)
            {
                slots.push(slot);
                views.push(view);
            }
        }
        let options = self.input.options;
        let found = triangulate_track(&views, options.max_error_px, options.min_angle)?;
        let mut active = vec![false; sightings.len()];
        for (&slot, &inlier) in slots.iter().zip(&found.inliers) {
            active[slot] = inlier;
        }
        Some(Triangulation { track, position: found.position, active })
    }

    fn apply(&mut self, found: Triangulation) -> usize {
        let track = &mut self.tracks[found.track];
        track.position = Some(found.position);
        let mut num_joined = 0;
        for (sighting, active) in track.sightings.iter_mut().zip(found.active) {
            num_joined += usize::from(active && !sighting.active);
            sighting.active = active;
        }
        num_joined
    }
}
