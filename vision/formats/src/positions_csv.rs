//! Positions of images in a metric, z-up frame.

use volery_scene::PositionPrior;

use crate::TableError;

/// The position of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedPosition {
    /// File name.
    pub image: String,
    /// Where.
    pub prior: PositionPrior,
}

/// Reads `image,x,y,z[,sigma]` or the columns `tx,ty,tz` of `poses.csv` (rotations are ignored).
/// `default_sigma` (meters) holds where no sigma is given.
pub fn read_positions_csv(
    bytes: &[u8],
    default_sigma: f64,
) -> Result<Vec<NamedPosition>, TableError> {
    let _ = (bytes, default_sigma);
    todo!()
}
