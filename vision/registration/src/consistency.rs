//! Transforms on which many correspondences agree, found without drawing samples.

use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;
use volery_geometry::isometry_from_points;

use crate::surfels::Surfel;

/// Transforms that are returned.
const MAX_HYPOTHESES: usize = 150;
/// Correspondences from which transforms are grown.
const MAX_SEEDS: usize = 400;
/// Fewest correspondences behind a transform.
const MIN_SUPPORT: usize = 6;
/// Normals of correspondences may differ by this much, cosine.
const NORMAL_SLACK: f64 = 0.25;
/// Two places closer than this, in slacks, agree by chance.
const LEAST_DISTANCE: f64 = 2.0;
/// Transforms that differ by less than this, in slacks and radians, are one.
const SAME_PLACE: f64 = 3.0;
const SAME_TURN: f64 = 0.2;

/// A transform with its support.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Hypothesis {
    pub(crate) target_from_source: Isometry3<f64>,
    /// Correspondences that it explains.
    pub(crate) num_inliers: usize,
}

/// A place in the source and the place in the target that may be the same.
pub(crate) type Correspondence = (Surfel, Surfel);

/// Rigid motions that many correspondences support, best first.
///
/// Two correspondences are compatible if distance and angles between the places are the same on
/// both sides. A right one is compatible with the other right ones, which are compatible with each
/// other; a wrong one is so with a few by chance. So for each correspondence those are counted
/// that are compatible with it and with each other, and transforms are grown from the best.
///
/// * `slack`: errors of places, units of both frames.
///
/// # Source
///
/// Chen, Sun, Yang and Tao, "SC²-PCR: A Second Order Spatial Compatibility for Efficient and Robust
/// Point Cloud Registration", CVPR 2022, eqs. (3)–(6), with the angles of Drost, Ulrich, Navab and
/// Ilic, "Model Globally, Match Locally", CVPR 2010, eq. (1), in the compatibility.
pub(crate) fn consistent_motions(all: &[Correspondence], slack: f64) -> Vec<Hypothesis> {
    let compatible = Compatibility::new(all, slack);
    let scores: Vec<u64> = (0..all.len()).into_par_iter().map(|i| compatible.score(i)).collect();
    let mut seeds: Vec<usize> = (0..all.len()).filter(|&i| scores[i] > 0).collect();
    seeds.sort_by(|&a, &b| scores[b].cmp(&scores[a]).then(a.cmp(&b)));

    let mut found: Vec<Hypothesis> = Vec::new();
    let mut explained = vec![false; all.len()];
    let mut num_seeds = 0;
    for seed in seeds {
        if explained[seed] || num_seeds == MAX_SEEDS {
            continue;
        }
        num_seeds += 1;
        let Some(hypothesis) = grow(all, &compatible.partners(seed), slack) else { continue };
        for (is_explained, pair) in explained.iter_mut().zip(all) {
            *is_explained |= is_inlier(&hypothesis.target_from_source, pair, slack);
        }
        if !found.iter().any(|other| is_same(other, &hypothesis, &all[seed].0.position, slack)) {
            found.push(hypothesis);
        }
    }
    found.sort_by_key(|hypothesis| std::cmp::Reverse(hypothesis.num_inliers));
    found.truncate(MAX_HYPOTHESES);
    found
}

/// Fits a seed with its partners, then all that agree with the fit.
fn grow(all: &[Correspondence], seed: &[usize], slack: f64) -> Option<Hypothesis> {
    let mut members = seed.to_vec();
    let mut fitted = None;
    for _ in 0..3 {
        let source: Vec<Point3<f64>> = members.iter().map(|&i| all[i].0.position).collect();
        let target: Vec<Point3<f64>> = members.iter().map(|&i| all[i].1.position).collect();
        let target_from_source = isometry_from_points(&source, &target).ok()?;
        let agrees = |i: &usize| is_inlier(&target_from_source, &all[*i], slack);
        members = (0..all.len()).filter(agrees).collect();
        if members.len() < MIN_SUPPORT {
            return None;
        }
        fitted = Some(Hypothesis { target_from_source, num_inliers: members.len() });
    }
    fitted
}

fn is_inlier(motion: &Isometry3<f64>, (source, target): &Correspondence, slack: f64) -> bool {
    (motion * source.position - target.position).norm_squared() < slack * slack
        && (motion * source.normal).dot(&target.normal) > 1.0 - NORMAL_SLACK
}

fn is_same(a: &Hypothesis, b: &Hypothesis, at: &Point3<f64>, slack: f64) -> bool {
    let (a, b) = (&a.target_from_source, &b.target_from_source);
    (a * at - b * at).norm() < SAME_PLACE * slack && a.rotation.angle_to(&b.rotation) < SAME_TURN
}

/// A symmetric matrix of bits.
struct Compatibility {
    words: usize,
    bits: Vec<u64>,
}

impl Compatibility {
    fn new(all: &[Correspondence], slack: f64) -> Self {
        let words = all.len().div_ceil(64);
        let mut bits = vec![0; words * all.len()];
        if words > 0 {
            bits.par_chunks_mut(words).enumerate().for_each(|(i, row)| {
                for (j, other) in all.iter().enumerate() {
                    if i != j && is_compatible(&all[i], other, slack) {
                        row[j / 64] |= 1 << (j % 64);
                    }
                }
            });
        }
        Self { words, bits }
    }

    fn row(&self, i: usize) -> &[u64] {
        &self.bits[i * self.words..(i + 1) * self.words]
    }

    fn set(&self, i: usize) -> impl Iterator<Item = usize> + '_ {
        self.row(i).iter().enumerate().flat_map(|(word, &bits)| {
            (0..64).filter(move |bit| bits >> bit & 1 == 1).map(move |bit| 64 * word + bit)
        })
    }

    /// How many are compatible with both (6).
    fn common(&self, i: usize, j: usize) -> u32 {
        self.row(i).iter().zip(self.row(j)).map(|(a, b)| (a & b).count_ones()).sum()
    }

    fn score(&self, i: usize) -> u64 {
        self.set(i).map(|j| u64::from(self.common(i, j))).sum()
    }

    /// The seed and those that share with it at least half of what the best one shares.
    fn partners(&self, seed: usize) -> Vec<usize> {
        let shared: Vec<(usize, u32)> = self.set(seed).map(|j| (j, self.common(seed, j))).collect();
        let most = shared.iter().map(|s| s.1).max().unwrap_or(0);
        let close = shared.into_iter().filter(|s| 2 * s.1 >= most).map(|s| s.0);
        std::iter::once(seed).chain(close).collect()
    }
}

fn is_compatible(a: &Correspondence, b: &Correspondence, slack: f64) -> bool {
    let (d1, d2) = (b.0.position - a.0.position, b.1.position - a.1.position);
    let (l1, l2) = (d1.norm(), d2.norm());
    if (l1 - l2).abs() > slack || l1.min(l2) < LEAST_DISTANCE * slack {
        return false;
    }
    let angles = |from: &Surfel, to: &Surfel, d: nalgebra::Vector3<f64>| {
        [from.normal.dot(&to.normal), from.normal.dot(&d), to.normal.dot(&d)]
    };
    let source = angles(&a.0, &b.0, d1 / l1);
    let target = angles(&a.1, &b.1, d2 / l2);
    source.iter().zip(target).all(|(s, t)| (s - t).abs() < NORMAL_SLACK)
}
