//! Which image joins next.

use nalgebra::Point2;

use super::working::WorkingModel;

/// Levels of the grid pyramid: 2×2 up to 64×64 cells.
const NUM_LEVELS: u32 = 6;

/// An image that sees points of the model but has no pose yet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Candidate {
    pub(crate) image: usize,
    /// Points of the model on its tracks.
    pub(crate) num_visible: usize,
    /// Their number and spread.
    pub(crate) score: u64,
}

impl WorkingModel<'_> {
    /// Images that may join, best first: many visible points, spread over the image.
    pub(crate) fn next_views(&self, min_visible: usize) -> Vec<Candidate> {
        let mut candidates: Vec<Candidate> = (0..self.num_images())
            .filter(|&image| self.usable[image] && self.poses[image].is_none())
            .filter_map(|image| {
                let visible: Vec<Point2<f64>> = self.image_tracks[image]
                    .iter()
                    .filter(|&&(track, _)| self.tracks[track as usize].position.is_some())
                    .map(|&(track, slot)| {
                        self.pixel(&self.tracks[track as usize].sightings[slot as usize])
                    })
                    .collect();
                let camera = self.camera(image);
                (visible.len() >= min_visible).then(|| Candidate {
                    image,
                    num_visible: visible.len(),
                    score: spread_score(&visible, camera.width, camera.height),
                })
            })
            .collect();
        candidates.sort_by_key(|c| (std::cmp::Reverse(c.score), c.image));
        candidates
    }
}

/// Occupied cells of a pyramid of grids over the image, a cell counting as many times as its grid
/// has rows: grows with the number of points and more with their spread.
///
/// Source: Schönberger & Frahm, "Structure-from-Motion Revisited", CVPR 2016, 4.2.
pub(crate) fn spread_score(pixels: &[Point2<f64>], width: u32, height: u32) -> u64 {
    let finest = 1u32 << NUM_LEVELS;
    let cell = |value: f64, size: u32| {
        ((value / f64::from(size) * f64::from(finest)).max(0.0) as u32).min(finest - 1)
    };
    let mut cells: Vec<(u32, u32)> =
        pixels.iter().map(|p| (cell(p.x, width), cell(p.y, height))).collect();
    let mut score = 0;
    for level in (1..=NUM_LEVELS).rev() {
        cells.sort_unstable();
        cells.dedup();
        score += cells.len() as u64 * (1 << level);
        for cell in &mut cells {
            *cell = (cell.0 / 2, cell.1 / 2);
        }
    }
    score
}

#[cfg(test)]
mod tests {
    use super::*;

    /// As many points say more about a pose when they are spread.
    #[test]
    fn spread_beats_clustered() {
        let spread: Vec<_> = (0..64)
            .map(|i| Point2::new(f64::from(i % 8) * 80.0 + 40.0, f64::from(i / 8) * 60.0 + 30.0))
            .collect();
        let clustered: Vec<_> = spread.iter().map(|p| Point2::new(p.x * 0.1, p.y * 0.1)).collect();
        assert!(spread_score(&spread, 640, 480) > 2 * spread_score(&clustered, 640, 480));
        assert!(spread_score(&spread, 640, 480) > spread_score(&spread[..32], 640, 480));
        assert_eq!(spread_score(&[], 640, 480), 0);
    }
}
