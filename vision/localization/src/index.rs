//! What localization needs of a map, made once per map version and shared by all requests.

mod serial;

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Matrix3, Point3};
use volery_features::{GlobalDescriptor, PackedDescriptors};
use volery_geometry::Camera;
use volery_scene::{CameraId, Descriptor, Point3d, PointId, SparseModel};

use crate::map_noise::{MapNoise, PoseNoise};

/// A point's deviation at most, relative to its distance from the nearest camera that saw it: a
/// point whose rays leave the depth open says nothing about it.
const MAX_RELATIVE_SIGMA: f64 = 0.2;

/// Everything of a map that localization reads: points, and per image the descriptors of the
/// keypoints that see one.
pub struct LocalizationIndex {
    pub(crate) points: Vec<MapPoint>,
    pub(crate) images: Vec<MapImage>,
    pub(crate) cameras: Vec<Camera>,
    /// Noise of the map's keypoints per coordinate, pixels.
    pub(crate) sigma_px: f64,
    /// Sightings of point p: `sightings[starts[p]..starts[p + 1]]`.
    starts: Vec<u32>,
    sightings: Vec<Sighting>,
}

/// A point of the map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct MapPoint {
    pub(crate) position: Point3<f64>,
    /// Of the position by the noise of its keypoints, square map units.
    pub(crate) covariance: Matrix3<f32>,
}

/// An image of the map.
pub(crate) struct MapImage {
    pub(crate) cam_from_world: Isometry3<f64>,
    pub(crate) center: Point3<f64>,
    /// Which of the index's cameras.
    pub(crate) camera: u32,
    pub(crate) noise: PoseNoise,
    pub(crate) global: GlobalDescriptor,
    /// Which point each row sees.
    pub(crate) points: Vec<u32>,
    /// One per row.
    pub(crate) descriptors: Vec<Descriptor>,
    pub(crate) packed: PackedDescriptors,
}

/// The keypoints of an image that see a point, row by row, in the order of the keypoints.
#[derive(Clone, Copy)]
pub struct ImageRows<'a> {
    /// Of the whole image.
    pub global: &'a GlobalDescriptor,
    /// Which point each row sees.
    pub points: &'a [u32],
    /// One per row.
    pub descriptors: &'a [Descriptor],
    /// The same, to be matched.
    pub packed: &'a PackedDescriptors,
}

/// One row of an image that sees a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Sighting {
    pub(crate) image: u32,
    pub(crate) row: u32,
}

impl MapImage {
    fn new(
        cam_from_world: Isometry3<f64>,
        camera: u32,
        noise: PoseNoise,
        global: GlobalDescriptor,
        points: Vec<u32>,
        descriptors: Vec<Descriptor>,
    ) -> Self {
        let center = volery_geometry::triangulation::camera_center(&cam_from_world);
        let packed = PackedDescriptors::new(&descriptors);
        Self { cam_from_world, center, camera, noise, global, points, descriptors, packed }
    }
}

impl LocalizationIndex {
    /// From a model (in the map frame) and, per image of `model.images` in order, the descriptors
    /// of all its keypoints and its global descriptor.
    pub fn new(
        model: &SparseModel,
        descriptors: &[Vec<Descriptor>],
        global_descriptors: &[GlobalDescriptor],
    ) -> Self {
        let noise = MapNoise::of(model);
        let mut index_of_point: BTreeMap<PointId, u32> = BTreeMap::new();
        let mut points = Vec::new();
        for (id, point) in &model.points {
            let Some(unit) = noise.unit_covariances.get(id) else { continue };
            let covariance = unit * (noise.sigma_px * noise.sigma_px);
            if is_usable(model, point, &covariance) {
                index_of_point.insert(*id, points.len() as u32);
                let covariance = covariance.map(|v| v as f32);
                points.push(MapPoint { position: point.position, covariance });
            }
        }
        let cameras: Vec<CameraId> = model.cameras.keys().copied().collect();
        let images = model.images.values().zip(descriptors).zip(global_descriptors);
        let images = images
            .zip(noise.poses)
            .map(|(((image, all), global), noise)| {
                let (mut seen, mut rows) = (Vec::new(), Vec::new());
                for (point, descriptor) in image.points.iter().zip(all) {
                    if let Some(point) = point.and_then(|id| index_of_point.get(&id)) {
                        seen.push(*point);
                        rows.push(*descriptor);
                    }
                }
                let camera = cameras.iter().position(|id| *id == image.camera).unwrap_or(0) as u32;
                MapImage::new(image.cam_from_world, camera, noise, global.clone(), seen, rows)
            })
            .collect();
        let cameras = model.cameras.values().copied().collect();
        Self::from_parts(points, images, cameras, noise.sigma_px)
    }

    fn from_parts(
        points: Vec<MapPoint>,
        images: Vec<MapImage>,
        cameras: Vec<Camera>,
        sigma_px: f64,
    ) -> Self {
        let mut starts = vec![0_u32; points.len() + 1];
        for &point in images.iter().flat_map(|image| &image.points) {
            starts[point as usize + 1] += 1;
        }
        for p in 0..points.len() {
            starts[p + 1] += starts[p];
        }
        let mut next = starts.clone();
        let none = Sighting { image: 0, row: 0 };
        let mut sightings = vec![none; starts[points.len()] as usize];
        for (image, map_image) in images.iter().enumerate() {
            for (row, &point) in map_image.points.iter().enumerate() {
                let slot = &mut next[point as usize];
                sightings[*slot as usize] = Sighting { image: image as u32, row: row as u32 };
                *slot += 1;
            }
        }
        Self { points, images, cameras, sigma_px, starts, sightings }
    }

    /// Number of points.
    pub fn num_points(&self) -> usize {
        self.points.len()
    }

    /// Number of images.
    pub fn num_images(&self) -> usize {
        self.images.len()
    }

    /// What an image of the map knows of its points, by its position in the order of the model.
    pub fn image_rows(&self, image: usize) -> Option<ImageRows<'_>> {
        let MapImage { global, points, descriptors, packed, .. } = self.images.get(image)?;
        Some(ImageRows { global, points, descriptors, packed })
    }

    /// Where a point lies, in the frame of the index.
    pub fn position(&self, point: u32) -> Option<Point3<f64>> {
        self.points.get(point as usize).map(|point| point.position)
    }

    pub(crate) fn sightings(&self, point: u32) -> &[Sighting] {
        let p = point as usize;
        &self.sightings[self.starts[p] as usize..self.starts[p + 1] as usize]
    }

    /// The bytes of the index, to be kept beside the map.
    pub fn to_bytes(&self) -> Vec<u8> {
        serial::to_bytes(self)
    }

    /// The inverse of [`Self::to_bytes`]; untrusted bytes give an error, never a panic.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, IndexError> {
        serial::from_bytes(bytes)
    }
}

/// Why bytes are not an index.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum IndexError {
    /// Truncated or inconsistent.
    #[error("localization index is damaged at byte {offset}")]
    Damaged {
        /// Where.
        offset: usize,
    },
}

/// Whether a point says where it is.
fn is_usable(model: &SparseModel, point: &Point3d, covariance: &Matrix3<f64>) -> bool {
    let images = point.track.iter().filter_map(|o| model.images.get(&o.image));
    let nearest =
        images.map(|image| (point.position - image.center()).norm()).fold(f64::INFINITY, f64::min);
    point.position.iter().all(|v| v.is_finite())
        && covariance.trace().sqrt() < MAX_RELATIVE_SIGMA * nearest
}
