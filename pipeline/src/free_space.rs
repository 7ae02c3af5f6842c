//! After the dense cloud: where there is air, and where nobody looked.

use nalgebra::{Point3, Vector3};
use volery_formats::{read_occupancy, write_occupancy};
use volery_mvs::{SpaceCarver, unseen_areas};
use volery_scene::{DepthMap, Occupancy, OccupancyGrid, PointCloud, Progress, SparseModel};

use crate::{
    cache::{Cache, KeyMaker},
    dense::Dense,
    error::{PipelineError, code},
    summary::{FreeSpaceSummary, UnseenAreaSummary},
};

/// Edge of a voxel, in distances between the points of the cloud: a surface fills its voxels.
const SPACINGS: f64 = 4.0;
/// Most voxels.
const MAX_VOXELS: f64 = 4e6;
/// Part of the points that may lie outside of the box on either side of an axis: a few of them are
/// nowhere.
const OUTSIDE: f64 = 0.002;
/// Voxels around the box.
const MARGIN: f64 = 3.0;
/// Unseen areas that are told.
const MAX_AREAS: usize = 8;

/// The grid around the cloud and the cameras, carved by the depth maps: from `cache`, or made.
pub(crate) fn free_space(
    dense: &Dense,
    model: &SparseModel,
    depth_maps: impl Iterator<Item = DepthMap>,
    cache: &Cache,
    progress: &dyn Progress,
) -> Result<OccupancyGrid, PipelineError> {
    let key = KeyMaker::new("free space").with(dense.key.as_bytes()).key();
    if let Some(grid) = cache.get(&key).and_then(|bytes| read_occupancy(&bytes).ok()) {
        return Ok(grid);
    }
    let (low, high) = bounds(&dense.cloud, model);
    let spacing = dense.summary.spacing.unwrap_or(0.0);
    let voxel = (SPACINGS * spacing).max(((high - low).product() / MAX_VOXELS).cbrt());
    let margin = Vector3::repeat(MARGIN * voxel);
    let carver = SpaceCarver::new(low - margin, high + margin, voxel);
    let mut carver = carver.ok_or_else(|| {
        PipelineError::plain(code::NO_DENSE_POINTS, "the dense cloud has no extent")
    })?;
    for map in depth_maps {
        progress.check()?;
        carver.add(&map);
    }
    let grid = carver.finish();
    cache.put(&key, &write_occupancy(&grid))?;
    Ok(grid)
}

/// The file of a grid and what is told of it.
pub(crate) fn described(grid: &OccupancyGrid) -> (Vec<u8>, FreeSpaceSummary) {
    let volume = |state| grid.count(state) as f64 * grid.voxel().powi(3);
    let areas = unseen_areas(grid, MAX_AREAS).into_iter().enumerate();
    let areas = areas.map(|(index, area)| UnseenAreaSummary {
        name: format!("unseen {}", index + 1),
        center: area.center.into(),
        size: area.size.into(),
        area: area.area,
    });
    let summary = FreeSpaceSummary {
        voxel: grid.voxel(),
        size: grid.size(),
        free: volume(Occupancy::Free),
        occupied: volume(Occupancy::Occupied),
        unseen: volume(Occupancy::Unseen),
        unseen_areas: areas.collect(),
    };
    (write_occupancy(grid), summary)
}

/// Corners of the box around the cameras and nearly all points.
fn bounds(cloud: &PointCloud, model: &SparseModel) -> (Point3<f64>, Point3<f64>) {
    let centers: Vec<Point3<f64>> = model.images.values().map(|image| image.center()).collect();
    let mut low = Point3::origin();
    let mut high = Point3::origin();
    for axis in 0..3 {
        let mut along: Vec<f32> = cloud.points.iter().map(|point| point.position[axis]).collect();
        along.sort_by(f32::total_cmp);
        let outside = (along.len() as f64 * OUTSIDE) as usize;
        let inner = along.get(outside..along.len() - outside).unwrap_or(&[]);
        let ends = inner.first().into_iter().chain(inner.last()).map(|&v| f64::from(v));
        let all = ends.chain(centers.iter().map(|center| center[axis]));
        let (least, most) = all
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        (low[axis], high[axis]) = (least, most);
    }
    (low, high)
}
