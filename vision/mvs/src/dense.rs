//! The stages of dense reconstruction, one after the other.

use volery_geometry::Camera;
use volery_scene::{Cancelled, DepthMap, ImageId, Photos, PointCloud, Progress, SparseModel};

use crate::passes::{Census, Passes};
use crate::shelf::{NotKept, Shelf};
use crate::thinning::ThinCloud;

/// How dense reconstruction works.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DenseOptions {
    /// Pixels of a depth map; larger photos are made smaller.
    pub max_pixels: u32,
    /// Other images that judge an image, at most 16.
    pub max_sources: usize,
    /// Images that are in memory at once, beside those that they are compared with. The result
    /// does not depend on it.
    pub cluster_size: usize,
    /// Side of the cells of which each gives one point, in widths of a middle pixel on its
    /// surface; 0 gives a point for every pixel that sees its surface best.
    pub cell_px: f32,
    /// Of the perturbations.
    pub seed: u64,
}

impl Default for DenseOptions {
    fn default() -> Self {
        Self { max_pixels: 320_000, max_sources: 8, cluster_size: 120, cell_px: 0.0, seed: 1 }
    }
}

/// Why there is no dense reconstruction.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum DenseError {
    /// No two images see enough of the same from far enough apart.
    #[error("no image has another one that could tell its depth")]
    NoSources,
    /// A photo is not there.
    #[error("image {} has no photo", image.0)]
    NoPhoto {
        /// Which image.
        image: ImageId,
    },
    /// A photo is not of the camera's size.
    #[error("photo of image {} is not of its camera's size", image.0)]
    WrongSize {
        /// Which image.
        image: ImageId,
    },
    /// A finished unit could not be kept.
    #[error(transparent)]
    NotKept(#[from] NotKept),
    /// The work was asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// A dense cloud and what it is made of.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Dense {
    /// In the frame of the model.
    pub cloud: PointCloud,
    /// Images with a depth map on the shelf.
    pub images: Vec<ImageId>,
    /// Pixels of the depth maps, and those with a depth.
    pub num_pixels: [usize; 2],
    /// Side of the cells of which each has one point; 0 if they were not made.
    pub cell: f32,
}

/// Depth maps and cloud of all images of `model` that others can judge.
///
/// * `shelf` gets every finished unit and is asked for it first; at the end it holds the photos
///   and the depth maps ([`depth_map`], [`small_photo`]). It must be of this model, of these photos and
///   options (but for `cluster_size` and `cell_px`).
///
/// # Errors
///
/// [`DenseError`].
pub fn reconstruct_dense(
    model: &SparseModel,
    photos: &dyn Photos,
    shelf: &dyn Shelf,
    options: &DenseOptions,
    progress: &dyn Progress,
) -> Result<Dense, DenseError> {
    let passes = Passes::new(model, photos, shelf, options, progress)?;
    passes.photometric()?;
    passes.geometric()?;
    passes.filter()?;
    passes.remove_seen_through()?;
    let Census { num_pixels, footprint } = passes.census()?;
    let cell = options.cell_px * footprint;
    let cloud = if cell > 0.0 {
        let mut thin = ThinCloud::new(cell);
        passes.fuse(|points| thin.add(&points))?;
        thin.finish()
    } else {
        let mut cloud = PointCloud::default();
        passes.fuse(|points| cloud.points.extend(points))?;
        cloud
    };
    Ok(Dense { cloud, images: passes.images(), num_pixels, cell })
}

/// The depth map of an image of [`Dense::images`]; `options` as they were.
pub fn depth_map(
    model: &SparseModel,
    shelf: &dyn Shelf,
    options: &DenseOptions,
    image: ImageId,
) -> Option<DepthMap> {
    crate::passes::finished_map(model, shelf, options, image)
}

/// The photo as the depth map of an image of [`Dense::images`] has its pixels: its camera, and sRGB
/// row by row.
pub fn small_photo(
    model: &SparseModel,
    shelf: &dyn Shelf,
    options: &DenseOptions,
    image: ImageId,
) -> Option<(Camera, Vec<[u8; 3]>)> {
    crate::passes::small_photo(model, shelf, options, image)
}
