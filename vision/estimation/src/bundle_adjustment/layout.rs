//! Where everything of a problem lies in memory: observations by point, unknowns in blocks.

use std::ops::Range;

use volery_geometry::MAX_CAMERA_PARAMS;

use super::{BundleProblem, IntrinsicsRefinement};

/// "None" in lists of indices.
pub(super) const NONE: u32 = u32::MAX;

/// Widest block of unknowns: one row of eight lanes.
pub(super) const LANES: usize = 8;

/// Unknowns of a pose: rotation, translation.
pub(super) const POSE_DIM: usize = 6;

/// Most blocks a camera is cut into.
const MAX_PIECES: usize = MAX_CAMERA_PARAMS.div_ceil(LANES);

/// Observations in a chunk, unless that makes more than [`MAX_CHUNKS`].
const CHUNK_OBSERVATIONS: usize = 8192;

/// Most chunks; each holds sums of its own, added in order, so that the result does not depend on
/// the number of threads.
pub(super) const MAX_CHUNKS: usize = 32;

/// The free intrinsics of a camera, cut into blocks.
#[derive(Debug, Clone, Default)]
pub(super) struct FreeIntrinsics {
    /// Indices of the parameters that move.
    pub(super) params: Vec<usize>,
    /// First block; the others follow.
    pub(super) first_block: usize,
}

impl FreeIntrinsics {
    /// Number of blocks.
    pub(super) fn num_pieces(&self) -> usize {
        self.params.len().div_ceil(LANES)
    }
}

/// The order of a problem. Points are visited in the order of their first pose, so that a row of
/// the reduced matrix meets its points close together.
#[derive(Debug)]
pub(super) struct Layout {
    /// Visited points: index into the problem.
    pub(super) point_ids: Vec<u32>,
    /// Observations of visited point p: `point_starts[p]..point_starts[p + 1]`.
    pub(super) point_starts: Vec<usize>,
    /// Pose of an observation.
    pub(super) observation_poses: Vec<u32>,
    /// Pixel of an observation.
    pub(super) observation_pixels: Vec<[f64; 2]>,
    /// Factors of visited point p, sorted by block.
    pub(super) factor_starts: Vec<usize>,
    /// Block of a factor.
    pub(super) factor_blocks: Vec<u32>,
    /// End of the factors of the point of a factor.
    pub(super) factor_ends: Vec<u32>,
    /// Factors of block b: `block_factors[block_starts[b]..block_starts[b + 1]]`.
    pub(super) block_starts: Vec<usize>,
    /// Factors sorted by block.
    pub(super) block_factors: Vec<u32>,
    /// Block of a pose, [`NONE`] for a constant one; poses come before intrinsics.
    pub(super) pose_blocks: Vec<u32>,
    /// Of each camera.
    pub(super) intrinsics: Vec<FreeIntrinsics>,
    /// Unknowns of a block.
    pub(super) block_dims: Vec<usize>,
    /// First scalar unknown of a block, and their number at the end.
    pub(super) block_offsets: Vec<usize>,
    /// Pairs of blocks `(row, column)` that share observations beside the points: a pose and its
    /// camera, the pieces of one camera. Sorted by row.
    pub(super) couplings: Vec<(u32, u32)>,
    /// Couplings of row b: `coupling_starts[b]..coupling_starts[b + 1]`.
    pub(super) coupling_starts: Vec<usize>,
    /// Ranges of visited points.
    pub(super) chunks: Vec<Range<usize>>,
}

impl Layout {
    /// Sorts a problem whose indices are in range.
    pub(super) fn new(problem: &BundleProblem) -> Self {
        let mut layout = Self::with_blocks(problem);
        layout.sort_observations(problem);
        layout.find_factors(problem);
        layout.cut_chunks();
        layout
    }

    /// Number of blocks.
    pub(super) fn num_blocks(&self) -> usize {
        self.block_dims.len()
    }

    /// Number of scalar unknowns of the reduced system.
    pub(super) fn num_unknowns(&self) -> usize {
        self.block_offsets[self.num_blocks()]
    }

    /// Factors of a range of visited points.
    pub(super) fn factors_of(&self, points: &Range<usize>) -> Range<usize> {
        self.factor_starts[points.start]..self.factor_starts[points.end]
    }

    fn with_blocks(problem: &BundleProblem) -> Self {
        let mut block_dims = Vec::new();
        let pose_blocks: Vec<u32> = problem
            .poses
            .iter()
            .map(|pose| {
                if pose.constant {
                    return NONE;
                }
                block_dims.push(POSE_DIM);
                block_dims.len() as u32 - 1
            })
            .collect();
        let intrinsics: Vec<_> = problem
            .cameras
            .iter()
            .map(|camera| {
                let free = FreeIntrinsics {
                    params: free_params(camera.camera.model, camera.refine),
                    first_block: block_dims.len(),
                };
                block_dims.extend(free.params.chunks(LANES).map(<[usize]>::len));
                free
            })
            .collect();
        let mut block_offsets = vec![0];
        for dim in &block_dims {
            block_offsets.push(block_offsets[block_offsets.len() - 1] + dim);
        }
        let (couplings, coupling_starts) = couplings(problem, &intrinsics, block_dims.len());
        Self {
            point_ids: Vec::new(),
            point_starts: Vec::new(),
            observation_poses: Vec::new(),
            observation_pixels: Vec::new(),
            factor_starts: Vec::new(),
            factor_blocks: Vec::new(),
            factor_ends: Vec::new(),
            block_starts: Vec::new(),
            block_factors: Vec::new(),
            pose_blocks,
            intrinsics,
            block_dims,
            block_offsets,
            couplings,
            coupling_starts,
            chunks: Vec::new(),
        }
    }

    fn sort_observations(&mut self, problem: &BundleProblem) {
        let observations = &problem.observations;
        let (starts, mut by_point) =
            group_by(observations.iter().map(|o| o.point as usize), problem.points.len());
        let mut first_pose = vec![0; problem.points.len()];
        for (point, first) in first_pose.iter_mut().enumerate() {
            let of_point = &mut by_point[starts[point]..starts[point + 1]];
            of_point.sort_unstable_by_key(|&o| (observations[o as usize].pose, o));
            *first = of_point
                .first()
                .map_or(problem.poses.len(), |&o| observations[o as usize].pose as usize);
        }
        let (_, by_pose) = group_by(first_pose.iter().copied(), problem.poses.len() + 1);

        self.observation_poses.reserve_exact(observations.len());
        self.observation_pixels.reserve_exact(observations.len());
        self.point_starts.push(0);
        for point in by_pose {
            let of_point = &by_point[starts[point as usize]..starts[point as usize + 1]];
            if of_point.is_empty() {
                continue;
            }
            for &observation in of_point {
                let observation = &observations[observation as usize];
                self.observation_poses.push(observation.pose);
                self.observation_pixels.push([observation.pixel.x, observation.pixel.y]);
            }
            self.point_ids.push(point);
            self.point_starts.push(self.observation_poses.len());
        }
    }

    /// One factor for each block that a free point meets.
    fn find_factors(&mut self, problem: &BundleProblem) {
        let mut pieces: Vec<u32> = Vec::with_capacity(MAX_PIECES);
        self.factor_blocks.reserve(self.observation_poses.len());
        self.factor_starts.push(0);
        for (index, &point) in self.point_ids.iter().enumerate() {
            let start = self.factor_blocks.len();
            if !problem.is_constant_point(point) {
                pieces.clear();
                let observations = self.point_starts[index]..self.point_starts[index + 1];
                for &pose in &self.observation_poses[observations] {
                    let block = self.pose_blocks[pose as usize];
                    if block != NONE
                        && (self.factor_blocks.len() == start
                            || self.factor_blocks.last() != Some(&block))
                    {
                        self.factor_blocks.push(block);
                    }
                    let free = &self.intrinsics[problem.poses[pose as usize].camera as usize];
                    for piece in 0..free.num_pieces() {
                        let block = (free.first_block + piece) as u32;
                        if !pieces.contains(&block) {
                            pieces.push(block);
                        }
                    }
                }
                pieces.sort_unstable();
                self.factor_blocks.extend(&pieces);
            }
            let end = self.factor_blocks.len();
            self.factor_ends.resize(end, end as u32);
            self.factor_starts.push(end);
        }
        (self.block_starts, self.block_factors) =
            group_by(self.factor_blocks.iter().map(|&b| b as usize), self.num_blocks());
    }

    fn cut_chunks(&mut self) {
        let num_observations = self.observation_poses.len();
        let num_chunks = (num_observations / CHUNK_OBSERVATIONS).clamp(1, MAX_CHUNKS);
        let mut start = 0;
        for chunk in 1..=num_chunks {
            let target = num_observations * chunk / num_chunks;
            let end = self.point_starts.partition_point(|&o| o < target).min(self.point_ids.len());
            if end > start {
                self.chunks.push(start..end);
                start = end;
            }
        }
    }
}

/// All couplings, sorted by row, and the starts of the rows.
fn couplings(
    problem: &BundleProblem,
    intrinsics: &[FreeIntrinsics],
    num_blocks: usize,
) -> (Vec<(u32, u32)>, Vec<usize>) {
    let mut couplings = Vec::new();
    let mut starts = vec![0];
    for pose in problem.poses.iter().filter(|pose| !pose.constant) {
        let free = &intrinsics[pose.camera as usize];
        let row = starts.len() as u32 - 1;
        couplings.extend((0..free.num_pieces()).map(|p| (row, (free.first_block + p) as u32)));
        starts.push(couplings.len());
    }
    for free in intrinsics {
        for row in 0..free.num_pieces() {
            for column in row + 1..free.num_pieces() {
                couplings
                    .push(((free.first_block + row) as u32, (free.first_block + column) as u32));
            }
            starts.push(couplings.len());
        }
    }
    debug_assert_eq!(starts.len(), num_blocks + 1);
    (couplings, starts)
}

/// Indices of the parameters that `refine` lets move.
fn free_params(model: volery_geometry::CameraModel, refine: IntrinsicsRefinement) -> Vec<usize> {
    let principal_point = model.num_focals();
    (0..model.num_params())
        .filter(|&index| {
            if index < principal_point {
                refine.focal
            } else if index < model.distortion_start() {
                refine.principal_point
            } else {
                refine.distortion
            }
        })
        .collect()
}

/// Stable counting sort of items by key: starts of each key's items, and the items.
fn group_by(keys: impl Iterator<Item = usize> + Clone, num_keys: usize) -> (Vec<usize>, Vec<u32>) {
    let mut starts = vec![0; num_keys + 1];
    for key in keys.clone() {
        starts[key + 1] += 1;
    }
    for key in 0..num_keys {
        starts[key + 1] += starts[key];
    }
    let mut next = starts.clone();
    let mut items = vec![0; starts[num_keys]];
    for (item, key) in keys.enumerate() {
        items[next[key]] = item as u32;
        next[key] += 1;
    }
    (starts, items)
}
