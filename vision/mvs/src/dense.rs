//! The stages of dense reconstruction, one after the other.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;

use volery_geometry::{Camera, SimdLevel};
use volery_scene::{
    Cancelled, DepthMap, ImageId, Photos, PointCloud, Progress, SparseModel, Stage,
};

use crate::clusters::clusters;
use crate::depth::Stereo;
use crate::filter::{filter_depth_maps, remove_seen_through};
use crate::fusion::fuse_depth_maps;
use crate::infer::infer_flat_surfaces;
use crate::patch_match::MAX_SOURCES;
use crate::selection::{Neighborhood, neighborhood};
use crate::working_image::{WorkingImage, working_camera};

/// Least side of a depth map, pixels.
const MIN_SIDE: u32 = 16;
/// Most pixels of a depth map that the vectors can address.
const MAX_PIXELS: u32 = 1 << 23;

/// How dense reconstruction works.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DenseOptions {
    /// Pixels of a depth map; larger photos are made smaller.
    pub max_pixels: u32,
    /// Other images that judge an image, at most 16.
    pub max_sources: usize,
    /// Images that are worked on at once: memory grows with it.
    pub cluster_size: usize,
    /// Of the perturbations.
    pub seed: u64,
}

impl Default for DenseOptions {
    fn default() -> Self {
        Self { max_pixels: 320_000, max_sources: 8, cluster_size: 120, seed: 1 }
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
    /// The work was asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// Depth maps and cloud of all images of `model` that others can judge.
///
/// The images are worked on in clusters; `finished` is given the depth maps of each.
///
/// # Errors
///
/// [`DenseError`].
pub fn reconstruct_dense(
    model: &SparseModel,
    photos: &dyn Photos,
    options: &DenseOptions,
    progress: &dyn Progress,
    finished: &mut dyn FnMut(Vec<DepthMap>),
) -> Result<PointCloud, DenseError> {
    let neighborhoods = neighborhoods(model, options);
    if neighborhoods.is_empty() {
        return Err(DenseError::NoSources);
    }
    let mut cloud = PointCloud::default();
    let (mut done, total) = (0, neighborhoods.len());
    for members in clusters(&neighborhoods, options.cluster_size.max(1)) {
        let cluster = Cluster::load(model, photos, &neighborhoods, &members, options)?;
        let unfiltered = cluster.depth_maps(progress, 2 * done, 2 * total)?;
        progress.report(Stage::Fusion, done, total);
        let mut maps = filter_depth_maps(&unfiltered);
        drop(unfiltered);
        progress.check()?;
        for map in &mut maps {
            infer_flat_surfaces(map, &cluster.images[&map.image].levels[0].gray);
        }
        maps = remove_seen_through(&maps);
        progress.check()?;
        let color = |map: &DepthMap, index: usize| cluster.images[&map.image].color(index);
        cloud.points.extend(fuse_depth_maps(&maps, &color).points);
        done += members.len();
        progress.report(Stage::Fusion, done, total);
        finished(maps);
    }
    Ok(cloud)
}

fn neighborhoods(model: &SparseModel, options: &DenseOptions) -> BTreeMap<ImageId, Neighborhood> {
    let of_image = |&id: &ImageId| {
        let working = working_camera_of(model, id, options)?;
        if working.width.min(working.height) < MIN_SIDE {
            return None;
        }
        let max_sources = options.max_sources.min(MAX_SOURCES);
        Some((id, neighborhood(model, id, &working, max_sources)?))
    };
    model.images.keys().filter_map(of_image).collect()
}

fn working_camera_of(
    model: &SparseModel,
    image: ImageId,
    options: &DenseOptions,
) -> Option<Camera> {
    let camera = model.cameras.get(&model.images.get(&image)?.camera)?;
    Some(working_camera(camera, options.max_pixels.min(MAX_PIXELS)))
}

/// Images that are worked on together, and those that judge them.
struct Cluster<'a> {
    members: &'a [ImageId],
    neighborhoods: &'a BTreeMap<ImageId, Neighborhood>,
    images: BTreeMap<ImageId, WorkingImage>,
    seed: u64,
}

impl<'a> Cluster<'a> {
    fn load(
        model: &SparseModel,
        photos: &dyn Photos,
        neighborhoods: &'a BTreeMap<ImageId, Neighborhood>,
        members: &'a [ImageId],
        options: &DenseOptions,
    ) -> Result<Self, DenseError> {
        let mut images = BTreeMap::new();
        for &id in members.iter().chain(members.iter().flat_map(|id| &neighborhoods[id].sources)) {
            if let Entry::Vacant(place) = images.entry(id) {
                place.insert(working_image(model, photos, id, options)?);
            }
        }
        Ok(Self { members, neighborhoods, images, seed: options.seed })
    }

    fn stereo(&self, image: ImageId) -> Stereo<'_> {
        let neighborhood = &self.neighborhoods[&image];
        Stereo {
            simd: SimdLevel::detect(),
            reference: &self.images[&image],
            sources: neighborhood.sources.iter().map(|source| &self.images[source]).collect(),
            neighborhood,
            seed: self.seed,
        }
    }

    /// Unfiltered depth maps of the members: first each alone, then beside the others.
    fn depth_maps(
        &self,
        progress: &dyn Progress,
        mut done: usize,
        total: usize,
    ) -> Result<Vec<DepthMap>, DenseError> {
        let mut maps = Vec::with_capacity(self.members.len());
        for &image in self.members {
            progress.check()?;
            maps.push(self.stereo(image).photometric());
            done += 1;
            progress.report(Stage::DepthMaps, done, total);
        }
        let inverse: BTreeMap<ImageId, Vec<f32>> = maps
            .iter()
            .map(|map| (map.image, map.depth.iter().map(|d| 1.0 / d).collect()))
            .collect();
        for map in &mut maps {
            progress.check()?;
            let stereo = self.stereo(map.image);
            let theirs: Vec<Option<&[f32]>> =
                stereo.sources.iter().map(|s| inverse.get(&s.id).map(Vec::as_slice)).collect();
            if theirs.iter().any(Option::is_some) {
                *map = stereo.geometric(map, &theirs);
            }
            done += 1;
            progress.report(Stage::DepthMaps, done, total);
        }
        Ok(maps)
    }
}

fn working_image(
    model: &SparseModel,
    photos: &dyn Photos,
    id: ImageId,
    options: &DenseOptions,
) -> Result<WorkingImage, DenseError> {
    let missing = DenseError::NoPhoto { image: id };
    let image = model.images.get(&id).ok_or(missing.clone())?;
    let camera = model.cameras.get(&image.camera).ok_or(missing.clone())?;
    let photo = photos.photo(id).ok_or(missing.clone())?;
    let num_pixels = photo.gray.pixels().len();
    if (photo.gray.width(), photo.gray.height()) != (camera.width, camera.height)
        || photo.colors.as_ref().is_some_and(|colors| colors.len() != num_pixels)
    {
        return Err(DenseError::WrongSize { image: id });
    }
    let working = working_camera_of(model, id, options).ok_or(missing)?;
    Ok(WorkingImage::new(id, &photo, camera, &working, image.cam_from_world))
}
