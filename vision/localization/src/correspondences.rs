//! Which keypoints of the query may see which points of the map.

use std::collections::BTreeMap;

use volery_features::{GlobalDescriptor, MatchOptions, PackedDescriptors, match_features};

use crate::LocalizationIndex;
use crate::localize::LocalizationPrior;

/// A keypoint of the query and a point of the map that it may see.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Pair {
    /// Of the features of the query.
    pub keypoint: u32,
    /// Of the index.
    pub point: u32,
}

/// Matches of the query with one map image.
pub(crate) struct ImageMatches {
    image: u32,
    pairs: Vec<Pair>,
}

/// Greatest ratio of the nearest to the second-nearest distance within one map image.
const MAX_RATIO: f32 = 0.8;

/// Points kept per keypoint: one where the map is unique, two where two places look alike.
const MAX_POINTS_PER_KEYPOINT: usize = 2;

/// Map images, those most likely to show the query's view first: by likeness, and alternately by
/// distance where a position is known.
pub(crate) fn rank_images(
    index: &LocalizationIndex,
    global: &GlobalDescriptor,
    prior: &LocalizationPrior,
) -> Vec<u32> {
    let ranked_by = |cost: &dyn Fn(usize) -> f64| {
        let mut costs: Vec<(f64, u32)> =
            (0..index.images.len()).map(|i| (cost(i), i as u32)).collect();
        costs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        costs.into_iter().map(|(_, image)| image).collect::<Vec<u32>>()
    };
    let by_likeness = ranked_by(&|i| -f64::from(global.similarity(&index.images[i].global)));
    let Some((position, _)) = prior.position else { return by_likeness };
    let by_distance = ranked_by(&|i| (index.images[i].center - position).norm());
    let mut is_taken = vec![false; index.images.len()];
    let both = by_distance.into_iter().zip(by_likeness).flat_map(|(a, b)| [a, b]);
    both.filter(|&image| !std::mem::replace(&mut is_taken[image as usize], true)).collect()
}

/// Matches of the query with each of `images`, best matched image first.
pub(crate) fn match_images(
    query: &PackedDescriptors,
    index: &LocalizationIndex,
    images: &[u32],
) -> Vec<ImageMatches> {
    let options = MatchOptions { max_ratio: MAX_RATIO };
    let mut all: Vec<ImageMatches> = images
        .iter()
        .map(|&image| {
            let map_image = &index.images[image as usize];
            let matches = match_features(query, &map_image.packed, &options);
            let pairs = matches.iter().map(|m| Pair {
                keypoint: m.feature1,
                point: map_image.points[m.feature2 as usize],
            });
            ImageMatches { image, pairs: pairs.collect() }
        })
        .collect();
    sort_by_matches(&mut all);
    all
}

/// Best matched image first.
pub(crate) fn sort_by_matches(all: &mut [ImageMatches]) {
    all.sort_by(|a, b| b.pairs.len().cmp(&a.pairs.len()).then(a.image.cmp(&b.image)));
}

/// Distinct pairs of the given images. Where a keypoint was matched to several points, the ones
/// that most images name are kept.
pub(crate) fn pool<'a>(matches: impl IntoIterator<Item = &'a ImageMatches>) -> Vec<Pair> {
    let mut votes: BTreeMap<Pair, u32> = BTreeMap::new();
    for pair in matches.into_iter().flat_map(|image| &image.pairs) {
        *votes.entry(*pair).or_default() += 1;
    }
    let votes: Vec<(Pair, u32)> = votes.into_iter().collect();
    let mut pairs = Vec::with_capacity(votes.len());
    for group in votes.chunk_by(|a, b| a.0.keypoint == b.0.keypoint) {
        let mut group = group.to_vec();
        group.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
        pairs.extend(group.iter().take(MAX_POINTS_PER_KEYPOINT).map(|&(pair, _)| pair));
    }
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of the points that a keypoint was matched to, those that most images name are kept.
    #[test]
    fn images_vote() {
        let image = |image, pairs: &[(u32, u32)]| ImageMatches {
            image,
            pairs: pairs.iter().map(|&(keypoint, point)| Pair { keypoint, point }).collect(),
        };
        let matches =
            [image(0, &[(1, 7), (2, 5)]), image(1, &[(1, 9)]), image(2, &[(1, 9), (1, 8), (1, 8)])];
        let pairs: Vec<(u32, u32)> =
            pool(&matches).iter().map(|pair| (pair.keypoint, pair.point)).collect();
        assert_eq!(pairs, [(1, 8), (1, 9), (2, 5)]);
    }
}
