//! After the sparse map: its images to a dense cloud.

use serde::{Deserialize, Serialize};
use volery_formats::{read_ply_of_cloud, write_ply_of_cloud};
use volery_mvs::{Dense as Made, DenseError, Item, NotKept, Shelf, depth_map, reconstruct_dense};
use volery_scene::{DepthMap, ImageId, PointCloud, Progress, SparseModel};

use crate::{
    cache::{Cache, Key, KeyMaker},
    error::{PipelineError, code},
    files::Files,
    options::StageOptions,
    report_surface::{ViewPicture, pictures},
    summary::DenseSummary,
};

/// A dense cloud with its file.
pub(crate) struct Dense {
    pub(crate) cloud: PointCloud,
    /// The content of `dense.ply`.
    pub(crate) ply: Vec<u8>,
    /// Hash of what it was made from.
    pub(crate) key: Key,
    pub(crate) summary: DenseSummary,
    /// A few photos beside their depth maps; none once the depth maps are gone.
    pub(crate) pictures: Vec<ViewPicture>,
    /// Whether it came from the cache.
    pub(crate) cached: bool,
}

/// What of a [`Dense`] is written as JSON in the cache, before the file.
#[derive(Serialize, Deserialize)]
struct Header {
    summary: DenseSummary,
}

/// The dense cloud of a model in the map frame: from `cache`, or made with its finished units kept
/// in `units`.
pub(crate) fn dense(
    files: &Files,
    model: &SparseModel,
    options: &StageOptions,
    [cache, units]: [&Cache; 2],
    progress: &dyn Progress,
) -> Result<Dense, PipelineError> {
    let key = key(files, model, options);
    let shelf = UnitShelf { cache: units, key };
    if let Some((summary, ply)) = cache.get(&key).and_then(|bytes| from_cache(&bytes))
        && let Ok(cloud) = read_ply_of_cloud(&ply)
        && shelf.num_depth_maps(model) == summary.num_depth_maps
    {
        let images: Vec<ImageId> = model.images.keys().copied().collect();
        let pictures = pictures(&images, model, &shelf, &options.dense);
        return Ok(Dense { cloud, ply, key, summary, pictures, cached: true });
    }
    let made = || reconstruct_dense(model, files, &shelf, &options.dense, progress);
    let made = match made() {
        // A unit was damaged; what led to it may be gone.
        Err(DenseError::NotKept(_)) => {
            model.images.keys().for_each(|id| shelf.clear(*id));
            made()
        }
        made => made,
    };
    let made = made.map_err(failure)?;
    let pictures = pictures(&made.images, model, &shelf, &options.dense);
    let Made { cloud, images, num_pixels: [num_pixels, num_known], cell } = made;
    let summary = DenseSummary {
        num_depth_maps: images.len(),
        num_pixels,
        num_known,
        num_points: cloud.points.len(),
        num_inferred: cloud.points.iter().filter(|point| point.inferred).count(),
        spacing: Some(f64::from(cell)),
        free_space: None,
        error: None,
    };
    if cloud.points.is_empty() {
        return Err(PipelineError::new(
            code::NO_DENSE_POINTS,
            format!("the {} depth maps confirm no point", summary.num_depth_maps),
            "show surfaces with texture from several places",
        ));
    }
    let ply = write_ply_of_cloud(&cloud);
    cache.put(&key, &to_cache(&summary, &ply)?)?;
    Ok(Dense { cloud, ply, key, summary, pictures, cached: false })
}

/// The depth maps of a dense cloud, each when it is asked for.
pub(crate) fn depth_maps<'a>(
    model: &'a SparseModel,
    options: &'a StageOptions,
    dense: &Dense,
    units: &'a Cache,
) -> impl Iterator<Item = DepthMap> + use<'a> {
    let shelf = UnitShelf { cache: units, key: dense.key };
    model.images.keys().filter_map(move |&id| depth_map(model, &shelf, &options.dense, id))
}

fn key(files: &Files, model: &SparseModel, options: &StageOptions) -> Key {
    let mut key = KeyMaker::new("dense").with_debug(&options.dense).with_debug(&model.cameras);
    for (id, image) in &model.images {
        let hash = files.get(*id).map(|file| file.hash);
        key = key.with_debug(&hash).with_debug(&(id, image.camera, image.cam_from_world));
    }
    for (id, point) in &model.points {
        key = key.with_debug(&(id, point.position, &point.track));
    }
    key.key()
}

fn to_cache(summary: &DenseSummary, ply: &[u8]) -> Result<Vec<u8>, PipelineError> {
    let header = serde_json::to_vec(&Header { summary: summary.clone() })
        .map_err(|e| PipelineError::plain(code::IO, e.to_string()))?;
    let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
    bytes.extend(header);
    bytes.extend(ply);
    Ok(bytes)
}

fn from_cache(bytes: &[u8]) -> Option<(DenseSummary, Vec<u8>)> {
    let (len, rest) = bytes.split_first_chunk::<8>()?;
    let (header, ply) = rest.split_at_checked(u64::from_le_bytes(*len) as usize)?;
    let Header { summary } = serde_json::from_slice(header).ok()?;
    Some((summary, ply.to_vec()))
}

fn failure(error: DenseError) -> PipelineError {
    match error {
        DenseError::Cancelled(cancelled) => cancelled.into(),
        DenseError::NoSources => PipelineError::new(
            code::TOO_FEW_VIEWS,
            error.to_string(),
            "take photos of the same surfaces from places some steps apart",
        ),
        DenseError::NoPhoto { .. } | DenseError::WrongSize { .. } | DenseError::NotKept(_) => {
            PipelineError::plain(code::IO, error.to_string())
        }
    }
}

/// Finished units of one dense reconstruction.
struct UnitShelf<'a> {
    cache: &'a Cache,
    /// Of the reconstruction.
    key: Key,
}

impl UnitShelf<'_> {
    fn unit(&self, image: ImageId, item: Item) -> Key {
        KeyMaker::new("unit").with(self.key.as_bytes()).with_debug(&(image, item)).key()
    }

    fn num_depth_maps(&self, model: &SparseModel) -> usize {
        model.images.keys().filter(|id| self.has(**id, Item::Finished)).count()
    }

    fn clear(&self, image: ImageId) {
        Item::ALL.into_iter().for_each(|item| self.forget(image, item));
    }
}

impl Shelf for UnitShelf<'_> {
    fn has(&self, image: ImageId, item: Item) -> bool {
        self.cache.has(&self.unit(image, item))
    }

    fn get(&self, image: ImageId, item: Item) -> Option<Vec<u8>> {
        self.cache.get(&self.unit(image, item))
    }

    fn put(&self, image: ImageId, item: Item, bytes: Vec<u8>) -> Result<(), NotKept> {
        self.cache.put(&self.unit(image, item), &bytes).map_err(|_| NotKept)
    }

    fn forget(&self, image: ImageId, item: Item) {
        self.cache.forget(&self.unit(image, item));
    }
}
