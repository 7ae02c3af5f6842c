//! Groups of images that fit into memory together (P44).

use std::collections::{BTreeMap, BTreeSet};

use volery_scene::ImageId;

use crate::selection::Neighborhood;

/// Splits the images into groups of at most `max_size` that need each other most: a group grows by
/// the image with the most sources in it.
///
/// Source: Furukawa et al., "Towards Internet-scale Multi-view Stereo", CVPR 2010, in spirit:
/// clusters of bounded size that keep the pairs which matter.
pub(crate) fn clusters(
    neighborhoods: &BTreeMap<ImageId, Neighborhood>,
    max_size: usize,
) -> Vec<Vec<ImageId>> {
    let mut links: BTreeMap<ImageId, BTreeMap<ImageId, usize>> = BTreeMap::new();
    for (&image, neighborhood) in neighborhoods {
        for source in neighborhood.sources.iter().filter(|s| neighborhoods.contains_key(s)) {
            *links.entry(image).or_default().entry(*source).or_default() += 1;
            *links.entry(*source).or_default().entry(image).or_default() += 1;
        }
    }
    let mut left: BTreeSet<ImageId> = neighborhoods.keys().copied().collect();
    let mut groups = Vec::new();
    while let Some(&first) = left.first() {
        let mut group = Vec::new();
        let mut pull: BTreeMap<ImageId, usize> = BTreeMap::new();
        let mut next = Some(first);
        while let Some(image) = next {
            left.remove(&image);
            group.push(image);
            for (&other, &weight) in links.get(&image).into_iter().flatten() {
                *pull.entry(other).or_default() += weight;
            }
            pull.retain(|other, _| left.contains(other));
            let strongest =
                pull.iter().max_by_key(|&(&id, &weight)| (weight, std::cmp::Reverse(id)));
            next = strongest.map(|(&id, _)| id).filter(|_| group.len() < max_size);
        }
        group.sort();
        groups.push(group);
    }
    groups
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chain of images, each judged by the two before and the two after it.
    fn chain(num: u32) -> BTreeMap<ImageId, Neighborhood> {
        let near = |i: u32| (i.saturating_sub(2)..(i + 3).min(num)).filter(move |&j| j != i);
        let hood = |i: u32| Neighborhood {
            sources: near(i).map(ImageId).collect(),
            relatives: Vec::new(),
            range: [0.1, 1.0],
            points: Vec::new(),
        };
        (0..num).map(|i| (ImageId(i), hood(i))).collect()
    }

    #[test]
    fn groups_are_bounded_connected_and_complete() {
        let groups = clusters(&chain(23), 8);
        assert_eq!(groups.len(), 3);
        for group in &groups {
            assert!(group.len() <= 8);
            assert!(group.windows(2).all(|pair| pair[1].0 - pair[0].0 <= 2), "{group:?}");
        }
        let mut all: Vec<u32> = groups.iter().flatten().map(|id| id.0).collect();
        all.sort();
        assert_eq!(all, (0..23).collect::<Vec<_>>());
    }

    #[test]
    fn unconnected_parts_stay_apart() {
        let mut two = chain(4);
        two.extend(chain(4).into_iter().map(|(id, hood)| {
            let sources = hood.sources.iter().map(|s| ImageId(s.0 + 100)).collect();
            (ImageId(id.0 + 100), Neighborhood { sources, ..hood })
        }));
        assert_eq!(clusters(&two, 50).len(), 2);
    }
}
