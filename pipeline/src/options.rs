//! What a preset means for each stage.

use volery_estimation::TwoViewOptions;
use volery_features::{MatchOptions, SiftOptions};
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
}

impl StageOptions {
    /// The options of a job.
    pub(crate) fn of(spec: &JobSpec) -> Self {
        let (max_image_size, max_features, first_octave, num_retrieved) = match spec.preset {
            Preset::Fast => (1024, 3000, 0, 12),
            Preset::Balanced => (1600, 8192, -1, 20),
            Preset::Best => (3200, 12_000, -1, 40),
        };
        Self {
            max_image_size: spec.max_image_size.unwrap_or(max_image_size),
            sift: SiftOptions { max_features, first_octave, ..SiftOptions::default() },
            pairs: PairOptions { num_retrieved, ..PairOptions::default() },
            matching: MatchOptions::default(),
            two_view: TwoViewOptions::default(),
            mapper: MapperOptions { seed: spec.seed, ..MapperOptions::default() },
        }
    }
}
