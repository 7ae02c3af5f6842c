//! What a preset means for each stage.

use volery_estimation::TwoViewOptions;
use volery_features::{MatchOptions, SiftOptions};
use volery_meshing::TextureOptions;
use volery_mvs::DenseOptions;
use volery_sfm::{MapperOptions, PairOptions};

use crate::spec::{JobSpec, Preset};

/// Options of every stage of one run.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StageOptions {
    /// Longest side of the image that features are taken from, pixels.
    pub(crate) max_image_size: u32,
    /// Features.
    pub(crate) sift: SiftOptions,
    /// Choice of pairs.
    pub(crate) pairs: PairOptions,
    /// Descriptor matching.
    pub(crate) matching: MatchOptions,
    /// Two-view geometry.
    pub(crate) two_view: TwoViewOptions,
    /// Mapping.
    pub(crate) mapper: MapperOptions,
    /// Depth maps and their fusion.
    pub(crate) dense: DenseOptions,
    /// Surface.
    pub(crate) mesh: MeshOptions,
}

/// Options of the mesh.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MeshOptions {
    /// Greatest depth of the octree.
    pub(crate) max_octree_depth: u32,
    /// Triangles at most.
    pub(crate) max_triangles: usize,
    /// Picture on the surface.
    pub(crate) texture: TextureOptions,
}

/// Pixels of depth maps that are in memory at once, beside those of relatives: at 10 bytes each,
/// and as many again for what is made of them.
const CLUSTER_PIXELS: u32 = 16_000_000;

/// Side of the cells of which each has one point, in widths of a middle pixel on its surface: the
/// depth of a pixel is judged by a window of several, so that no detail is lost.
const CELL_PX: f32 = 2.0;

impl StageOptions {
    /// The options of a job.
    pub(crate) fn of(spec: &JobSpec) -> Self {
        let effort = spec.preset.effort(&spec.options);
        let dense = DenseOptions {
            max_pixels: effort.depth_map_pixels,
            max_sources: effort.depth_map_sources as usize,
            cluster_size: (CLUSTER_PIXELS / effort.depth_map_pixels) as usize,
            cell_px: CELL_PX,
            seed: spec.seed,
        };
        // Upsampling finds more features, and smaller ones.
        let first_octave = if spec.preset == Preset::Fast { 0 } else { -1 };
        let max_features = effort.max_features as usize;
        let num_retrieved = effort.similar_images as usize;
        Self {
            max_image_size: effort.max_image_size,
            sift: SiftOptions { max_features, first_octave, ..SiftOptions::default() },
            pairs: PairOptions { num_retrieved, ..PairOptions::default() },
            matching: MatchOptions::default(),
            two_view: TwoViewOptions::default(),
            mapper: MapperOptions {
                seed: spec.seed,
                poses_are_given: spec.poses.is_given(),
                ..MapperOptions::default()
            },
            dense,
            mesh: MeshOptions {
                max_octree_depth: effort.octree_depth,
                max_triangles: effort.max_triangles as usize,
                texture: TextureOptions { max_side: effort.texture_size },
            },
        }
    }
}
