//! Where the model comes back to a place it has drifted from.

use volery_estimation::BundleOptions;
use volery_scene::{Cancelled, Progress};

use super::working::WorkingModel;

/// Verified matches of a pair worth a look.
const MIN_MATCHES: usize = 30;
/// A pair that shares a smaller part of its matches as points is torn.
const TORN_FRACTION: f64 = 0.3;
/// How far drift may have moved a point, in multiples of the error limit of sightings.
const MAX_DRIFT_FACTOR: f64 = 10.0;
/// Mended sightings a pair needs to be believed.
const MIN_MENDED: usize = 15;
/// The loss that lets mended sightings pull.
const MENDING: BundleOptions =
    BundleOptions { max_iterations: 15, loss_scale_px: Some(8.0), cost_tolerance: 1e-4 };

const NONE: u32 = u32::MAX;

impl WorkingModel<'_> {
    /// Joins the two copies of points that torn pairs see, then adjusts with a wide loss. Returns
    /// the number of mended sightings.
    pub(crate) fn close_loops(&mut self, progress: &dyn Progress) -> Result<usize, Cancelled> {
        let mut track_of: Vec<Vec<u32>> =
            self.input.images.iter().map(|image| vec![NONE; image.keypoints.len()]).collect();
        for (index, track) in self.tracks.iter().enumerate() {
            for s in &track.sightings {
                track_of[s.image as usize][s.keypoint as usize] = index as u32;
            }
        }
        let mut num_mended = 0;
        for pair in self.input.pairs {
            let (i, j) = (pair.image1.0 as usize, pair.image2.0 as usize);
            if pair.num_inliers() < MIN_MATCHES
                || self.poses[i].is_none()
                || self.poses[j].is_none()
            {
                continue;
            }
            num_mended += self.mend_pair(pair, &mut track_of);
        }
        if num_mended > 0 {
            self.adjust_all(&MENDING, progress)?;
            self.complete_tracks(2.0 * self.input.options.max_error_px);
            self.filter_points();
        }
        Ok(num_mended)
    }

    fn mend_pair(
        &mut self,
        pair: &volery_scene::TwoViewGeometry,
        track_of: &mut [Vec<u32>],
    ) -> usize {
        let (i, j) = (pair.image1.0 as usize, pair.image2.0 as usize);
        let limit = MAX_DRIFT_FACTOR * self.input.options.max_error_px;
        let (mut num_known, mut num_shared) = (0usize, 0usize);
        let mut torn = Vec::new();
        for m in &pair.matches {
            let (Some(&a), Some(&b)) =
                (track_of[i].get(m.feature1 as usize), track_of[j].get(m.feature2 as usize))
            else {
                continue;
            };
            if a == NONE || b == NONE {
                continue;
            }
            let a_has = self.tracks[a as usize].position.is_some();
            let b_has = self.tracks[b as usize].position.is_some();
            if !a_has && !b_has {
                continue;
            }
            num_known += 1;
            let active = |track: u32, image: usize, keypoint: u32| {
                self.tracks[track as usize]
                    .sightings
                    .iter()
                    .any(|s| s.image as usize == image && s.keypoint == keypoint && s.active)
            };
            if a == b && active(a, i, m.feature1) && active(b, j, m.feature2) {
                num_shared += 1;
            } else {
                torn.push((a, b));
            }
        }
        if num_known < MIN_MATCHES || num_shared as f64 >= TORN_FRACTION * num_known as f64 {
            return 0;
        }
        // Look before mending: enough of the torn points must lie within the drift.
        let fits = |model: &Self, a: u32, b: u32| {
            let (from, to) = (&model.tracks[a as usize], &model.tracks[b as usize]);
            let Some(point) = from.position.or(to.position) else { return false };
            [from, to].into_iter().flat_map(|t| &t.sightings).all(|s| {
                (s.image as usize != i && s.image as usize != j)
                    || model.reprojection_error(s, &point) <= limit
            })
        };
        torn.retain(|&(a, b)| fits(self, a, b));
        if torn.len() < MIN_MENDED {
            return 0;
        }
        torn.into_iter().map(|(a, b)| self.mend(a as usize, b as usize, limit, track_of)).sum()
    }

    /// Joins `b` into `a` and lets every sighting within `limit` take part.
    fn mend(&mut self, a: usize, b: usize, limit: f64, track_of: &mut [Vec<u32>]) -> usize {
        if a != b {
            let shares_image = self.tracks[a]
                .sightings
                .iter()
                .any(|s| self.tracks[b].sightings.iter().any(|other| other.image == s.image));
            if shares_image {
                return 0;
            }
            let moved = std::mem::take(&mut self.tracks[b].sightings);
            let position = self.tracks[b].position.take();
            if self.tracks[a].position.is_none() {
                self.tracks[a].position = position;
            }
            for sighting in moved {
                let image = sighting.image as usize;
                self.image_tracks[image].retain(|&(track, _)| track as usize != b);
                let slot = self.tracks[a].sightings.len() as u32;
                self.image_tracks[image].push((a as u32, slot));
                track_of[image][sighting.keypoint as usize] = a as u32;
                self.tracks[a].sightings.push(sighting);
            }
        }
        let Some(point) = self.tracks[a].position else { return 0 };
        let mut num_mended = 0;
        for slot in 0..self.tracks[a].sightings.len() {
            let sighting = self.tracks[a].sightings[slot];
            if !sighting.active && self.reprojection_error(&sighting, &point) <= limit {
                self.tracks[a].sightings[slot].active = true;
                num_mended += 1;
            }
        }
        num_mended + usize::from(a != b)
    }
}
