//! The passes over all images. Each goes from cluster to cluster and puts what it finishes on the
//! shelf; the next one starts when all images are through.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;
use volery_geometry::{Camera, CameraModel, SimdLevel};
use volery_scene::{DepthMap, ImageId, OrientedPoint, Photos, Progress, SparseModel, Stage};

use crate::clusters::clusters;
use crate::dense::{DenseError, DenseOptions};
use crate::depth::Stereo;
use crate::filter::{confirmed, not_seen_through};
use crate::fusion::fused;
use crate::infer::infer_flat_surfaces;
use crate::patch_match::MAX_SOURCES;
use crate::selection::{Neighborhood, neighborhood};
use crate::shelf::{Item, Shelf, bytes_of_map, map_of_bytes};
use crate::working_image::{WorkingImage, beyond_the_photo, working_camera};

/// Least side of a depth map, pixels.
const MIN_SIDE: u32 = 16;
/// Most pixels of a depth map that the vectors can address.
const MAX_PIXELS: u32 = 1 << 23;

/// What the passes have in common.
pub(crate) struct Passes<'a> {
    model: &'a SparseModel,
    photos: &'a dyn Photos,
    shelf: &'a dyn Shelf,
    options: &'a DenseOptions,
    progress: &'a dyn Progress,
    neighborhoods: BTreeMap<ImageId, Neighborhood>,
    clusters: Vec<Vec<ImageId>>,
}

/// What the depth maps are in sum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Census {
    /// Pixels of the depth maps, and those with a depth.
    pub(crate) num_pixels: [usize; 2],
    /// Width of a middle pixel on the surface that it sees, in the middle depth map.
    pub(crate) footprint: f32,
}

impl<'a> Passes<'a> {
    pub(crate) fn new(
        model: &'a SparseModel,
        photos: &'a dyn Photos,
        shelf: &'a dyn Shelf,
        options: &'a DenseOptions,
        progress: &'a dyn Progress,
    ) -> Result<Self, DenseError> {
        let of_image = |&id: &ImageId| {
            let working = camera_of(model, options, id)?;
            let large_enough = working.width.min(working.height) >= MIN_SIDE;
            let max_sources = options.max_sources.min(MAX_SOURCES);
            Some((id, large_enough.then(|| neighborhood(model, id, &working, max_sources))??))
        };
        let ids: Vec<ImageId> = model.images.keys().copied().collect();
        let neighborhoods: BTreeMap<_, _> = ids.par_iter().filter_map(of_image).collect();
        if neighborhoods.is_empty() {
            return Err(DenseError::NoSources);
        }
        let clusters = clusters(&neighborhoods, options.cluster_size.max(1));
        Ok(Self { model, photos, shelf, options, progress, neighborhoods, clusters })
    }

    pub(crate) fn images(&self) -> Vec<ImageId> {
        self.neighborhoods.keys().copied().collect()
    }

    /// First pass: each image by the others' pixels.
    pub(crate) fn photometric(&self) -> Result<(), DenseError> {
        self.stereo_pass(Item::Photometric, 0, |stereo, _| Ok(stereo.photometric()))
    }

    /// Second pass: each image beside the others' depth maps.
    pub(crate) fn geometric(&self) -> Result<(), DenseError> {
        self.stereo_pass(Item::Geometric, self.neighborhoods.len(), |stereo, cluster| {
            let id = stereo.reference.id;
            let own = &cluster.maps[&id];
            let theirs: Vec<Option<&[f32]>> = stereo
                .sources
                .iter()
                .map(|s| cluster.inverse.get(&s.id).map(Vec::as_slice))
                .collect();
            let alone = theirs.iter().all(Option::is_none);
            let map = if alone { own.clone() } else { stereo.geometric(own, &theirs) };
            Ok(self.within_the_photo(map))
        })
    }

    /// Without the pixels that the photo does not show.
    fn within_the_photo(&self, mut map: DepthMap) -> DepthMap {
        let image = self.model.images.get(&map.image);
        let camera = image.and_then(|image| self.model.cameras.get(&image.camera));
        let working = map.camera;
        if let Some(camera) = camera.filter(|camera| camera.model != CameraModel::Pinhole) {
            beyond_the_photo(camera, &working).for_each(|index| map.clear(index));
        }
        map
    }

    fn stereo_pass(
        &self,
        item: Item,
        already_done: usize,
        compute: impl Fn(&Stereo<'_>, &StereoCluster) -> Result<DepthMap, DenseError>,
    ) -> Result<(), DenseError> {
        let (mut done, total) = (already_done, 2 * self.neighborhoods.len());
        self.progress.report(Stage::DepthMaps, done, total);
        for members in &self.clusters {
            let missing: Vec<ImageId> =
                members.iter().copied().filter(|&id| !self.is_past(id, item)).collect();
            done += members.len() - missing.len();
            let cluster = self.stereo_cluster(&missing, item)?;
            for id in missing {
                self.progress.check()?;
                let neighborhood = &self.neighborhoods[&id];
                let stereo = Stereo {
                    simd: SimdLevel::detect(),
                    reference: &cluster.images[&id],
                    sources: neighborhood.sources.iter().map(|s| &cluster.images[s]).collect(),
                    neighborhood,
                    seed: self.options.seed,
                };
                let map = compute(&stereo, &cluster)?;
                self.shelf.put(id, item, bytes_of_map(&map))?;
                done += 1;
                self.progress.report(Stage::DepthMaps, done, total);
            }
        }
        self.forget_before(item);
        Ok(())
    }

    /// What the `missing` images of a cluster need.
    fn stereo_cluster(&self, missing: &[ImageId], item: Item) -> Result<StereoCluster, DenseError> {
        let sources = missing.iter().flat_map(|id| &self.neighborhoods[id].sources);
        let ids: BTreeSet<ImageId> = missing.iter().chain(sources).copied().collect();
        let images = ids
            .par_iter()
            .map(|&id| Ok((id, self.working_image(id)?)))
            .collect::<Result<_, DenseError>>()?;
        let maps = match item {
            Item::Photometric => BTreeMap::new(),
            _ => self.maps(&ids, Item::Photometric)?,
        };
        let invert = |(id, map): (&ImageId, &DepthMap)| {
            (*id, map.depth.iter().map(|depth| 1.0 / depth).collect())
        };
        let inverse = maps.iter().map(invert).collect();
        Ok(StereoCluster { images, maps, inverse })
    }

    /// Third pass: what others confirm is kept, flat surfaces are concluded from it.
    pub(crate) fn filter(&self) -> Result<(), DenseError> {
        self.map_pass(Item::Geometric, Item::Filtered, 0, |map, others| {
            let mut kept = confirmed(map, others.values());
            infer_flat_surfaces(&mut kept, &self.working_image(map.image)?.levels[0].gray);
            Ok(self.within_the_photo(kept))
        })
    }

    /// Fourth pass: what others see through is forgotten.
    pub(crate) fn remove_seen_through(&self) -> Result<(), DenseError> {
        let done = self.neighborhoods.len();
        self.map_pass(Item::Filtered, Item::Finished, done, |map, others| {
            Ok(not_seen_through(map, others.values()))
        })
    }

    fn map_pass(
        &self,
        from: Item,
        to: Item,
        already_done: usize,
        compute: impl Fn(&DepthMap, &BTreeMap<ImageId, DepthMap>) -> Result<DepthMap, DenseError> + Sync,
    ) -> Result<(), DenseError> {
        let total = 3 * self.neighborhoods.len();
        let done = Mutex::new(already_done);
        self.progress.report(Stage::Fusion, already_done, total);
        for members in &self.clusters {
            let missing: Vec<ImageId> =
                members.iter().copied().filter(|&id| !self.is_past(id, to)).collect();
            *done.lock().unwrap_or_else(PoisonError::into_inner) += members.len() - missing.len();
            let maps = self.maps(&self.with_relatives(&missing), from)?;
            missing.par_iter().try_for_each(|id| {
                self.progress.check()?;
                let map = compute(&maps[id], &maps)?;
                self.shelf.put(*id, to, bytes_of_map(&map))?;
                self.one_more(&done, total);
                Ok::<(), DenseError>(())
            })?;
        }
        self.forget_before(to);
        Ok(())
    }

    /// Counts the finished maps, one cluster after the other.
    pub(crate) fn census(&self) -> Result<Census, DenseError> {
        let mut num_pixels = [0; 2];
        let mut footprints = Vec::new();
        for members in &self.clusters {
            self.progress.check()?;
            for map in self.maps(&members.iter().copied().collect(), Item::Finished)?.values() {
                num_pixels[0] += map.depth.len();
                num_pixels[1] += map.num_known();
                footprints.extend(footprint(map));
            }
        }
        footprints.sort_by(f32::total_cmp);
        let footprint = footprints.get(footprints.len() / 2).copied().unwrap_or(0.0);
        Ok(Census { num_pixels, footprint })
    }

    /// Last pass: every surface once, by the image that sees it largest. `take` gets the points of
    /// one cluster after the other.
    pub(crate) fn fuse(&self, mut take: impl FnMut(Vec<OrientedPoint>)) -> Result<(), DenseError> {
        let total = 3 * self.neighborhoods.len();
        let done = Mutex::new(2 * self.neighborhoods.len());
        for members in &self.clusters {
            let maps = self.maps(&self.with_relatives(members), Item::Finished)?;
            let points: Vec<Vec<OrientedPoint>> = members
                .par_iter()
                .map(|id| {
                    self.progress.check()?;
                    let photo = self.working_image(*id)?;
                    let points = fused(&maps[id], maps.values(), &|index| photo.color(index));
                    self.one_more(&done, total);
                    Ok(points)
                })
                .collect::<Result<_, DenseError>>()?;
            points.into_iter().for_each(&mut take);
        }
        Ok(())
    }

    /// An image more of the fusion is done.
    fn one_more(&self, done: &Mutex<usize>, total: usize) {
        let mut done = done.lock().unwrap_or_else(PoisonError::into_inner);
        *done += 1;
        self.progress.report(Stage::Fusion, *done, total);
    }

    fn with_relatives(&self, members: &[ImageId]) -> BTreeSet<ImageId> {
        let relatives = members.iter().flat_map(|id| &self.neighborhoods[id].relatives);
        let with_map = relatives.filter(|id| self.neighborhoods.contains_key(id));
        members.iter().chain(with_map).copied().collect()
    }

    fn maps(
        &self,
        ids: &BTreeSet<ImageId>,
        item: Item,
    ) -> Result<BTreeMap<ImageId, DepthMap>, DenseError> {
        let with_map: Vec<ImageId> =
            ids.iter().copied().filter(|id| self.neighborhoods.contains_key(id)).collect();
        with_map
            .into_par_iter()
            .map(|id| {
                let map = map_from(self.model, self.shelf, self.options, id, item);
                Ok((id, map.ok_or(DenseError::NotKept(crate::shelf::NotKept))?))
            })
            .collect()
    }

    /// Whether a unit or one made from it is on the shelf.
    fn is_past(&self, image: ImageId, item: Item) -> bool {
        Item::ALL.into_iter().any(|made| made >= item && self.shelf.has(image, made))
    }

    /// What led to a pass that all images are through is of no use any more.
    fn forget_before(&self, item: Item) {
        for &id in self.neighborhoods.keys() {
            let past = Item::ALL.into_iter().filter(|&past| Item::Photo < past && past < item);
            past.for_each(|past| self.shelf.forget(id, past));
        }
    }

    /// The undistorted photo, from the shelf if it is there.
    fn working_image(&self, id: ImageId) -> Result<WorkingImage, DenseError> {
        let missing = DenseError::NoPhoto { image: id };
        let image = self.model.images.get(&id).ok_or(missing.clone())?;
        let camera = self.model.cameras.get(&image.camera).ok_or(missing.clone())?;
        let working = camera_of(self.model, self.options, id).ok_or(missing.clone())?;
        let kept = self.shelf.get(id, Item::Photo);
        let kept = kept
            .and_then(|bytes| WorkingImage::from_bytes(id, &bytes, &working, image.cam_from_world));
        if let Some(kept) = kept {
            return Ok(kept);
        }
        let photo = self.photos.photo(id).ok_or(missing)?;
        let num_pixels = photo.gray.pixels().len();
        if (photo.gray.width(), photo.gray.height()) != (camera.width, camera.height)
            || photo.colors.as_ref().is_some_and(|colors| colors.len() != num_pixels)
        {
            return Err(DenseError::WrongSize { image: id });
        }
        let made = WorkingImage::new(id, &photo, camera, &working, image.cam_from_world);
        self.shelf.put(id, Item::Photo, made.to_bytes())?;
        Ok(made)
    }
}

/// Images that are worked on together with those that judge them.
struct StereoCluster {
    images: BTreeMap<ImageId, WorkingImage>,
    maps: BTreeMap<ImageId, DepthMap>,
    /// Inverse depths, row by row.
    inverse: BTreeMap<ImageId, Vec<f32>>,
}

fn camera_of(model: &SparseModel, options: &DenseOptions, image: ImageId) -> Option<Camera> {
    let camera = model.cameras.get(&model.images.get(&image)?.camera)?;
    Some(working_camera(camera, options.max_pixels.min(MAX_PIXELS)))
}

fn map_from(
    model: &SparseModel,
    shelf: &dyn Shelf,
    options: &DenseOptions,
    image: ImageId,
    item: Item,
) -> Option<DepthMap> {
    let camera = camera_of(model, options, image)?;
    map_of_bytes(&shelf.get(image, item)?, image, camera, model.images.get(&image)?.cam_from_world)
}

/// See [`crate::dense::depth_map`].
pub(crate) fn finished_map(
    model: &SparseModel,
    shelf: &dyn Shelf,
    options: &DenseOptions,
    image: ImageId,
) -> Option<DepthMap> {
    map_from(model, shelf, options, image, Item::Finished)
}

/// See [`crate::dense::small_photo`].
pub(crate) fn small_photo(
    model: &SparseModel,
    shelf: &dyn Shelf,
    options: &DenseOptions,
    id: ImageId,
) -> Option<(Camera, Vec<[u8; 3]>)> {
    let working = camera_of(model, options, id)?;
    let pose = model.images.get(&id)?.cam_from_world;
    let image = WorkingImage::from_bytes(id, &shelf.get(id, Item::Photo)?, &working, pose)?;
    let num_pixels = image.levels[0].gray.pixels().len();
    Some((working, (0..num_pixels).map(|index| image.color(index)).collect()))
}

/// Width of the middle one of the pixels with a depth on the surface that it sees.
fn footprint(map: &DepthMap) -> Option<f32> {
    let mut depths: Vec<f32> = map.depth.iter().copied().filter(|depth| *depth > 0.0).collect();
    let middle = depths.len() / 2;
    if depths.is_empty() {
        return None;
    }
    let (_, median, _) = depths.select_nth_unstable_by(middle, f32::total_cmp);
    Some(*median / map.camera.mean_focal() as f32)
}
