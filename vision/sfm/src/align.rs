//! Gravity, scale, origin and forward vector: a reconstruction becomes an environment map.

use volery_scene::{EnvironmentMap, ImagePrior, KnownDistance, OriginRule};

use crate::Reconstruction;

/// Options of [`environment_map`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct AlignOptions {
    /// Which point is the origin.
    pub origin: OriginRule,
    /// Measured distances.
    pub known_distances: Vec<KnownDistance>,
}

/// The map of a reconstruction: z up, x forward (P50, P51), metric where a prior says so.
///
/// `priors[i]` belongs to `ImageId(i)`.
pub fn environment_map(
    reconstruction: Reconstruction,
    priors: &[ImagePrior],
    options: &AlignOptions,
) -> EnvironmentMap {
    let _ = (reconstruction, priors, options);
    todo!()
}
