//! Exact nearest-neighbor matching.

mod distance;
mod guided;
mod nearest;
mod packed;
mod simd;

use volery_scene::FeatureMatch;

use crate::simd::SimdLevel;
pub use distance::squared_distance;
pub use guided::match_guided;
use nearest::{Nearest, nearest_both_ways};
pub use packed::PackedDescriptors;

/// Greatest distance of a match of unit descriptors (COLMAP's 0.7), squared, in squared bytes of
/// descriptors of norm 256.
const MAX_SQUARED_DISTANCE: i32 = 32113;

/// Options of [`match_features`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatchOptions {
    /// Greatest ratio of the nearest to the second-nearest distance.
    pub max_ratio: f32,
}

impl Default for MatchOptions {
    fn default() -> Self {
        Self { max_ratio: 0.8 }
    }
}

/// Mutual nearest neighbors that pass the ratio test both ways, sorted by `feature1`.
///
/// Distances are Euclidean and exact; of equally near neighbors the one with the lower index is
/// nearest. Runs on the calling thread.
pub fn match_features(
    features1: &PackedDescriptors,
    features2: &PackedDescriptors,
    options: &MatchOptions,
) -> Vec<FeatureMatch> {
    match_features_with(SimdLevel::detect(), features1, features2, options)
}

fn match_features_with(
    level: SimdLevel,
    features1: &PackedDescriptors,
    features2: &PackedDescriptors,
    options: &MatchOptions,
) -> Vec<FeatureMatch> {
    if features1.is_empty() || features2.is_empty() {
        return Vec::new();
    }
    let (rows, columns) = nearest_both_ways(level, features1, features2);
    mutual(&rows, &columns, options)
}

/// Pairs that are each other's nearest and pass the tests both ways.
fn mutual(rows: &[Nearest], columns: &[Nearest], options: &MatchOptions) -> Vec<FeatureMatch> {
    let mut matches = Vec::new();
    for (feature1, row) in rows.iter().enumerate() {
        let Some(column) = columns.get(row.index as usize) else { continue };
        if column.index as usize == feature1
            && row.similarity >= -MAX_SQUARED_DISTANCE
            && is_distinct(row, options.max_ratio)
            && is_distinct(column, options.max_ratio)
        {
            matches.push(FeatureMatch { feature1: feature1 as u32, feature2: row.index });
        }
    }
    matches
}

/// The ratio test on squared distances.
fn is_distinct(nearest: &Nearest, max_ratio: f32) -> bool {
    let squared_ratio = f64::from(max_ratio) * f64::from(max_ratio);
    nearest
        .second_similarity
        .is_none_or(|second| -f64::from(nearest.similarity) < squared_ratio * -f64::from(second))
}

#[cfg(test)]
mod tests;
