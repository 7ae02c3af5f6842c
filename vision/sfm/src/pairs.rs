//! Which image pairs to match.

use rayon::prelude::*;
use volery_features::GlobalDescriptor;
use volery_scene::ImagePrior;

/// Options of [`select_pairs`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairOptions {
    /// Up to so many images every pair is matched.
    pub max_exhaustive_images: usize,
    /// Neighbors on either side in the order of the images.
    pub num_sequential: usize,
    /// Most alike images per image.
    pub num_retrieved: usize,
}

impl Default for PairOptions {
    fn default() -> Self {
        Self { max_exhaustive_images: 120, num_sequential: 8, num_retrieved: 20 }
    }
}

/// Nearest images by position prior that are paired.
const NUM_SPATIAL: usize = 8;
/// Difference of heading, radians, beyond which two images at one place show different things.
const MAX_YAW_DIFFERENCE: f64 = 1.2;
/// Best-ranked images that are paired whether or not the liking is mutual.
const NUM_CERTAIN: usize = 5;

/// Index pairs `(i, j)`, `i < j`, sorted. Linear in the number of images beyond
/// `max_exhaustive_images`. `priors` may add pairs by yaw and position; empty or one per image.
///
/// The number of images is that of the global descriptors, or of the priors if there are none.
/// Order of capture adds the `num_sequential` neighbors and, at distances that double, a few far
/// ones; retrieval adds images that like each other (each among the other's `num_retrieved`) and
/// the first few of everyone's list.
pub fn select_pairs(
    global_descriptors: &[GlobalDescriptor],
    priors: &[ImagePrior],
    options: &PairOptions,
) -> Vec<(usize, usize)> {
    let n = if global_descriptors.is_empty() { priors.len() } else { global_descriptors.len() };
    if n <= options.max_exhaustive_images {
        return (0..n).flat_map(|i| (i + 1..n).map(move |j| (i, j))).collect();
    }
    let mut pairs = Vec::new();
    for i in 0..n {
        pairs.extend((i + 1..=i + options.num_sequential).map(|j| (i, j)));
        let doubling =
            std::iter::successors(Some(2 * options.num_sequential.max(1)), |d| Some(d * 2));
        pairs.extend(doubling.take(3).map(|d| (i, i + d)));
    }
    pairs.retain(|&(_, j)| j < n);
    if global_descriptors.len() == n {
        pairs.extend(retrieved_pairs(global_descriptors, options.num_retrieved));
    }
    if priors.len() == n {
        pairs.extend(spatial_pairs(priors));
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

fn ordered(i: usize, j: usize) -> (usize, usize) {
    (i.min(j), i.max(j))
}

/// Pairs of images that are among each other's `k` most alike, and everyone's very first ones.
fn retrieved_pairs(descriptors: &[GlobalDescriptor], k: usize) -> Vec<(usize, usize)> {
    let nearest: Vec<Vec<usize>> = (0..descriptors.len())
        .into_par_iter()
        .map(|i| {
            let mut others: Vec<(f32, usize)> = (0..descriptors.len())
                .filter(|&j| j != i)
                .map(|j| (descriptors[i].similarity(&descriptors[j]), j))
                .collect();
            others.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
            others.truncate(k);
            others.into_iter().map(|(_, j)| j).collect()
        })
        .collect();
    let mut pairs = Vec::new();
    for (i, list) in nearest.iter().enumerate() {
        for (rank, &j) in list.iter().enumerate() {
            if rank < NUM_CERTAIN || nearest[j].contains(&i) {
                pairs.push(ordered(i, j));
            }
        }
    }
    pairs
}

/// Pairs of neighbors by position prior that look the same way, as far as the yaw is known.
fn spatial_pairs(priors: &[ImagePrior]) -> Vec<(usize, usize)> {
    let looks_alike = |i: usize, j: usize| match (priors[i].attitude, priors[j].attitude) {
        (Some(a), Some(b)) => {
            let difference = (a.yaw - b.yaw).sin().atan2((a.yaw - b.yaw).cos()).abs();
            difference <= MAX_YAW_DIFFERENCE
        }
        _ => true,
    };
    (0..priors.len())
        .into_par_iter()
        .flat_map_iter(|i| {
            let mut others: Vec<(f64, usize)> = priors[i].position.map_or(Vec::new(), |here| {
                (0..priors.len())
                    .filter(|&j| j != i && looks_alike(i, j))
                    .filter_map(|j| {
                        let there = priors[j].position?;
                        Some(((there.position - here.position).norm_squared(), j))
                    })
                    .collect()
            });
            others.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            others.into_iter().take(NUM_SPATIAL).map(move |(_, j)| ordered(i, j))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;
    use volery_scene::PositionPrior;

    /// Images of `n` places on a circle, `n` images each place 0, 1, …, n-1, 0, 1, …
    fn descriptors(num_images: usize, num_places: usize) -> Vec<GlobalDescriptor> {
        (0..num_images)
            .map(|i| {
                let angle = (i % num_places) as f32 / num_places as f32 * std::f32::consts::TAU;
                GlobalDescriptor(vec![angle.cos(), angle.sin()])
            })
            .collect()
    }

    #[test]
    fn few_images_are_all_paired() {
        let options = PairOptions::default();
        let pairs = select_pairs(&descriptors(5, 5), &[], &options);
        assert_eq!(pairs.len(), 10);
        assert!(pairs.iter().all(|&(i, j)| i < j));
        assert!(select_pairs(&descriptors(1, 1), &[], &options).is_empty());
        assert!(select_pairs(&[], &[], &options).is_empty());
    }

    /// Ten times the images, about ten times the pairs.
    #[test]
    fn pairs_grow_linearly() {
        let options = PairOptions { max_exhaustive_images: 10, ..PairOptions::default() };
        let few = select_pairs(&descriptors(100, 100), &[], &options).len();
        let many = select_pairs(&descriptors(1000, 1000), &[], &options).len();
        assert!(many < 11 * few, "{few} pairs of 100 images, {many} of 1000");
        assert!(many <= 1000 * (options.num_sequential + 3 + options.num_retrieved));
    }

    /// The second round passes the places of the first: every revisit is paired.
    #[test]
    fn revisited_places_are_paired() {
        let options =
            PairOptions { max_exhaustive_images: 10, num_sequential: 2, num_retrieved: 4 };
        let pairs = select_pairs(&descriptors(200, 100), &[], &options);
        for i in 0..100 {
            assert!(pairs.binary_search(&(i, i + 100)).is_ok(), "place {i}");
        }
        assert!(pairs.windows(2).all(|w| w[0] < w[1]), "sorted and without doubles");
    }

    #[test]
    fn near_positions_are_paired() {
        let options =
            PairOptions { max_exhaustive_images: 10, num_sequential: 1, num_retrieved: 1 };
        let priors: Vec<ImagePrior> = (0..40)
            .map(|i| ImagePrior {
                position: Some(PositionPrior {
                    position: Point3::new(f64::from(i % 20), 0.0, 0.0),
                    sigma: 0.05,
                }),
                ..ImagePrior::default()
            })
            .collect();
        let pairs = select_pairs(&[], &priors, &options);
        assert!((0..20).all(|i| pairs.binary_search(&(i, i + 20)).is_ok()));
    }
}
