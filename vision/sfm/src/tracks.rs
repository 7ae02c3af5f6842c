//! Tracks: which keypoints of many images are sightings of one point.

use volery_scene::{ImageId, Observation, TwoViewGeometry};

use crate::SfmImage;

/// Connected components of the verified matches, none of which holds two keypoints of one image.
///
/// Matches are joined pair by pair, pairs with most inliers first; a match that would put two
/// keypoints of one image into a track is refused, so a wrong match costs itself and not the
/// tracks it would glue together. Keypoints at exactly the same location (one extremum with
/// several orientations) count as one, the lowest index standing for all.
///
/// Tracks have at least two observations, are sorted by image, and come in the order of their
/// first observation. Matches with an index out of range are ignored.
pub fn build_tracks(images: &[SfmImage], pairs: &[TwoViewGeometry]) -> Vec<Vec<Observation>> {
    let mut first_node = Vec::with_capacity(images.len() + 1);
    let mut num_nodes = 0usize;
    for image in images {
        first_node.push(num_nodes);
        num_nodes += image.keypoints.len();
    }
    first_node.push(num_nodes);
    let canonical: Vec<Vec<u32>> = images.iter().map(same_place).collect();
    let node = |image: ImageId, keypoint: u32| -> Option<usize> {
        let image = image.0 as usize;
        let keypoint = *canonical.get(image)?.get(keypoint as usize)?;
        Some(first_node[image] + keypoint as usize)
    };

    let mut order: Vec<&TwoViewGeometry> = pairs.iter().collect();
    order.sort_by_key(|pair| (std::cmp::Reverse(pair.num_inliers()), pair.image1, pair.image2));
    let mut forest = Forest::new(num_nodes);
    for pair in order {
        for m in &pair.matches {
            let (Some(node1), Some(node2)) =
                (node(pair.image1, m.feature1), node(pair.image2, m.feature2))
            else {
                continue;
            };
            forest.join((node1, pair.image1.0), (node2, pair.image2.0));
        }
    }
    collect_tracks(images, &first_node, &mut forest)
}

/// For every keypoint the lowest index of a keypoint at the same location.
pub(crate) fn same_place(image: &SfmImage) -> Vec<u32> {
    let mut order: Vec<u32> = (0..image.keypoints.len() as u32).collect();
    let key = |i: u32| {
        let p = &image.keypoints[i as usize];
        (p.x.to_bits(), p.y.to_bits(), i)
    };
    order.sort_unstable_by_key(|&i| key(i));
    let mut canonical = vec![0; order.len()];
    let mut first = 0;
    for (position, &i) in order.iter().enumerate() {
        let previous = order[position.saturating_sub(1)] as usize;
        if position == 0 || image.keypoints[previous] != image.keypoints[i as usize] {
            first = i;
        }
        canonical[i as usize] = first;
    }
    canonical
}

fn collect_tracks(
    images: &[SfmImage],
    first_node: &[usize],
    forest: &mut Forest,
) -> Vec<Vec<Observation>> {
    let mut track_of_root = vec![u32::MAX; forest.parent.len()];
    let mut tracks: Vec<Vec<Observation>> = Vec::new();
    for (index, image) in images.iter().enumerate() {
        for keypoint in 0..image.keypoints.len() {
            let root = forest.root(first_node[index] + keypoint);
            if forest.images[root].len() < 2 {
                continue;
            }
            if track_of_root[root] == u32::MAX {
                track_of_root[root] = tracks.len() as u32;
                tracks.push(Vec::with_capacity(forest.images[root].len()));
            }
            tracks[track_of_root[root] as usize]
                .push(Observation { image: ImageId(index as u32), keypoint: keypoint as u32 });
        }
    }
    tracks
}

/// Union-find whose sets know the images they touch.
struct Forest {
    parent: Vec<u32>,
    /// Sorted images of the set of a root; empty for a node that was never joined.
    images: Vec<Vec<u32>>,
}

impl Forest {
    fn new(num_nodes: usize) -> Self {
        Self { parent: (0..num_nodes as u32).collect(), images: vec![Vec::new(); num_nodes] }
    }

    fn root(&mut self, node: usize) -> usize {
        let mut root = node;
        while self.parent[root] as usize != root {
            // Path halving.
            self.parent[root] = self.parent[self.parent[root] as usize];
            root = self.parent[root] as usize;
        }
        root
    }

    /// Joins the sets of two `(node, image)` unless they share an image.
    fn join(&mut self, a: (usize, u32), b: (usize, u32)) {
        let (mut root_a, mut root_b) = (self.root(a.0), self.root(b.0));
        if root_a == root_b {
            return;
        }
        for (root, image) in [(root_a, a.1), (root_b, b.1)] {
            if self.images[root].is_empty() {
                self.images[root].push(image);
            }
        }
        if self.images[root_a].len() < self.images[root_b].len() {
            std::mem::swap(&mut root_a, &mut root_b);
        }
        let smaller = std::mem::take(&mut self.images[root_b]);
        let larger = &mut self.images[root_a];
        if smaller.iter().any(|image| larger.binary_search(image).is_ok()) {
            self.images[root_b] = smaller;
            return;
        }
        larger.extend(smaller);
        larger.sort_unstable();
        self.parent[root_b] = root_a as u32;
    }
}

#[cfg(test)]
mod tests {

    use nalgebra::Point2;
    use volery_scene::{FeatureMatch, TwoViewKind};

    use super::*;

    fn image(id: u32, keypoints: &[(f64, f64)]) -> SfmImage {
        let keypoints = keypoints.iter().map(|&(x, y)| Point2::new(x, y)).collect();
        SfmImage::from_keypoints(id as usize, keypoints)
    }

    fn pair(image1: u32, image2: u32, matches: &[(u32, u32)]) -> TwoViewGeometry {
        TwoViewGeometry {
            image1: ImageId(image1),
            image2: ImageId(image2),
            kind: TwoViewKind::General,
            matches: matches
                .iter()
                .map(|&(feature1, feature2)| FeatureMatch { feature1, feature2 })
                .collect(),
            num_putative: matches.len(),
            cam2_from_cam1: None,
            fundamental: None,
            homography: None,
            median_parallax: 0.0,
        }
    }

    fn track(observations: &[(u32, u32)]) -> Vec<Observation> {
        observations
            .iter()
            .map(|&(image, keypoint)| Observation { image: ImageId(image), keypoint })
            .collect()
    }

    fn three_images() -> Vec<SfmImage> {
        (0..3).map(|id| image(id, &[(1.0, 1.0), (5.0, 5.0), (9.0, 9.0)])).collect()
    }

    #[test]
    fn matches_chain_into_tracks() {
        let pairs = [pair(0, 1, &[(0, 1), (2, 2)]), pair(1, 2, &[(1, 0)])];
        let tracks = build_tracks(&three_images(), &pairs);
        assert_eq!(tracks, vec![track(&[(0, 0), (1, 1), (2, 0)]), track(&[(0, 2), (1, 2)])]);
    }

    /// A wrong match that would glue two tracks is refused, the stronger pairs win.
    #[test]
    fn no_track_holds_two_keypoints_of_one_image() {
        let pairs = [
            pair(0, 2, &[(1, 0)]),
            pair(0, 1, &[(0, 0), (1, 1), (2, 2)]),
            pair(1, 2, &[(0, 0), (1, 1)]),
        ];
        let tracks = build_tracks(&three_images(), &pairs);
        assert_eq!(tracks[0], track(&[(0, 0), (1, 0), (2, 0)]));
        assert_eq!(tracks[1], track(&[(0, 1), (1, 1), (2, 1)]));
        assert_eq!(tracks.len(), 3);
    }

    /// One extremum with two orientations gives one track, not two.
    #[test]
    fn keypoints_at_one_place_are_one() {
        let images =
            [image(0, &[(1.0, 1.0), (1.0, 1.0)]), image(1, &[(2.0, 2.0), (3.0, 3.0), (2.0, 2.0)])];
        let tracks = build_tracks(&images, &[pair(0, 1, &[(0, 0), (1, 2)])]);
        assert_eq!(tracks, vec![track(&[(0, 0), (1, 0)])]);
    }

    #[test]
    fn nothing_and_nonsense_give_no_tracks() {
        assert!(build_tracks(&[], &[]).is_empty());
        assert!(
            build_tracks(&three_images(), &[pair(0, 1, &[(7, 0)]), pair(0, 9, &[(0, 0)])])
                .is_empty()
        );
    }
}
