//! The two nearest neighbors of every descriptor of both images, in one pass.

use volery_scene::DESCRIPTOR_LEN;

use super::packed::{PADDING_NORM, PackedDescriptors, QUERIES, TILE, TILE_BYTES};
use super::simd;
use crate::simd::SimdLevel;

/// Lanes of a row's running best.
pub(super) const LANES: usize = 16;
/// Queries whose running bests stay in the first-level cache while a tile passes.
const QUERY_BLOCK: usize = 64;
/// Nothing seen yet.
pub(super) const NONE: i32 = -(1 << 30);

/// Nearest and second-nearest neighbor of one descriptor. Similarity is minus the squared
/// distance, in squared bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Nearest {
    pub(super) similarity: i32,
    pub(super) index: u32,
    /// `None` if the other image has one descriptor only.
    pub(super) second_similarity: Option<i32>,
}

/// Running bests, lane by lane: structure of arrays over `N` lanes.
#[derive(Debug, Clone)]
#[repr(C, align(64))]
pub(super) struct Best<const N: usize> {
    pub(super) first: [i32; N],
    pub(super) second: [i32; N],
    pub(super) index: [i32; N],
}

impl<const N: usize> Best<N> {
    const EMPTY: Self = Self { first: [NONE; N], second: [NONE; N], index: [0; N] };

    /// Takes `similarity` of neighbor `index` into lane `lane`; equal ones leave the first.
    pub(super) fn update(&mut self, lane: usize, similarity: i32, index: i32) {
        if similarity > self.first[lane] {
            self.second[lane] = self.first[lane];
            self.first[lane] = similarity;
            self.index[lane] = index;
        } else if similarity > self.second[lane] {
            self.second[lane] = similarity;
        }
    }
}

/// What a kernel works on: some queries against one tile.
pub(super) struct Block<'a> {
    pub(super) queries: &'a [[i8; DESCRIPTOR_LEN]],
    pub(super) query_norms: &'a [i32],
    /// Index of the first query.
    pub(super) first_query: usize,
    pub(super) tile: &'a [u8; TILE_BYTES],
    pub(super) tile_norms: &'a [i32; TILE],
    /// Index of the first descriptor of the tile.
    pub(super) first_column: usize,
}

/// Nearest neighbors of all of `features1` in `features2` and the reverse. Equal distances go to
/// the lower index.
pub(super) fn nearest_both_ways(
    level: SimdLevel,
    features1: &PackedDescriptors,
    features2: &PackedDescriptors,
) -> (Vec<Nearest>, Vec<Nearest>) {
    let num_queries = features1.len().next_multiple_of(QUERIES);
    let mut columns = vec![Best::<TILE>::EMPTY; features2.tiles().len()];
    let mut rows = Vec::with_capacity(features1.len());
    let mut bests = vec![Best::<LANES>::EMPTY; QUERY_BLOCK];
    for first_query in (0..num_queries).step_by(QUERY_BLOCK) {
        let range = first_query..(first_query + QUERY_BLOCK).min(num_queries);
        bests.fill(Best::EMPTY);
        for (tile_index, (tile, column)) in features2.tiles().iter().zip(&mut columns).enumerate() {
            let first_column = tile_index * TILE;
            let block = Block {
                queries: &features1.rows()[range.clone()],
                query_norms: &features1.norms()[range.clone()],
                first_query,
                tile,
                tile_norms: features2.norms()[first_column..]
                    .first_chunk()
                    .expect("norms are padded to whole tiles"),
                first_column,
            };
            simd::update(level, &block, &mut bests, column);
        }
        rows.extend(bests[..range.len()].iter().map(across_lanes));
    }
    rows.truncate(features1.len());
    let columns = columns
        .iter()
        .flat_map(|best| (0..TILE).map(|i| nearest(best.first[i], best.index[i], best.second[i])))
        .take(features2.len())
        .collect();
    (rows, columns)
}

/// The best of all lanes; lane l holds the neighbors whose index is l modulo the lanes.
fn across_lanes(best: &Best<LANES>) -> Nearest {
    let winner = (0..LANES)
        .max_by_key(|&l| (best.first[l], std::cmp::Reverse(best.index[l])))
        .expect("there are lanes");
    let second = (0..LANES)
        .filter(|&l| l != winner)
        .map(|l| best.first[l])
        .fold(best.second[winner], i32::max);
    nearest(best.first[winner], best.index[winner], second)
}

fn nearest(similarity: i32, index: i32, second: i32) -> Nearest {
    let second_similarity = (second > -PADDING_NORM).then_some(second);
    Nearest { similarity, index: index as u32, second_similarity }
}
