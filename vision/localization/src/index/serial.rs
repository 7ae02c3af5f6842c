//! The index as bytes: little endian, kind and version, points, images.

use nalgebra::{Isometry3, Matrix3, Point3, Quaternion, Translation3, UnitQuaternion, Vector6};
use volery_features::GlobalDescriptor;
use volery_geometry::{Camera, CameraModel};
use volery_scene::{DESCRIPTOR_LEN, Descriptor};

use super::{IndexError, LocalizationIndex, MapImage, MapPoint};
use crate::bytes::ByteReader;
use crate::map_noise::PoseNoise;

const KIND: &[u8; 8] = b"VLRYLOC3";

/// Position and the upper triangle of the covariance.
const POINT_BYTES: usize = 3 * 8 + 6 * 4;
/// Model, size and count of the parameters.
const MIN_CAMERA_BYTES: usize = 4 * 4;
/// Pose, camera, and the counts of its modes, global descriptor and rows.
const MIN_IMAGE_BYTES: usize = 7 * 8 + 4 + 3 * 4;
const ROW_BYTES: usize = 4 + DESCRIPTOR_LEN;

const UPPER_TRIANGLE: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

pub(super) fn to_bytes(index: &LocalizationIndex) -> Vec<u8> {
    let num_rows: usize = index.images.iter().map(|image| image.points.len()).sum();
    let mut bytes = Vec::with_capacity(
        64 + index.points.len() * POINT_BYTES + num_rows * ROW_BYTES + index.images.len() * 4096,
    );
    bytes.extend(KIND);
    bytes.extend((index.points.len() as u32).to_le_bytes());
    for point in &index.points {
        bytes.extend(point.position.iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend(UPPER_TRIANGLE.iter().flat_map(|&at| point.covariance[at].to_le_bytes()));
    }
    bytes.extend(index.sigma_px.to_le_bytes());
    bytes.extend((index.cameras.len() as u32).to_le_bytes());
    for camera in &index.cameras {
        bytes.extend(camera.model.colmap_id().to_le_bytes());
        bytes.extend(camera.width.to_le_bytes());
        bytes.extend(camera.height.to_le_bytes());
        bytes.extend((camera.params().len() as u32).to_le_bytes());
        bytes.extend(camera.params().iter().flat_map(|v| v.to_le_bytes()));
    }
    bytes.extend((index.images.len() as u32).to_le_bytes());
    for image in &index.images {
        let pose = &image.cam_from_world;
        let numbers = pose.rotation.coords.iter().chain(pose.translation.vector.iter());
        bytes.extend(numbers.flat_map(|v| v.to_le_bytes()));
        bytes.extend(image.camera.to_le_bytes());
        bytes.extend((image.noise.0.len() as u32).to_le_bytes());
        let modes = image.noise.0.iter().flat_map(|mode| mode.iter());
        bytes.extend(modes.flat_map(|v| v.to_le_bytes()));
        bytes.extend((image.global.0.len() as u32).to_le_bytes());
        bytes.extend(image.global.0.iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend((image.points.len() as u32).to_le_bytes());
        bytes.extend(image.points.iter().flat_map(|point| point.to_le_bytes()));
        bytes.extend(image.descriptors.iter().flatten());
    }
    bytes
}

pub(super) fn from_bytes(bytes: &[u8]) -> Result<LocalizationIndex, IndexError> {
    let mut reader = ByteReader::new(bytes);
    if reader.take(8)? != KIND {
        return Err(IndexError::Damaged { offset: 0 });
    }
    let num_points = reader.count(POINT_BYTES)?;
    let mut points = Vec::with_capacity(num_points);
    for _ in 0..num_points {
        let position = Point3::new(reader.f64()?, reader.f64()?, reader.f64()?);
        let mut covariance = Matrix3::zeros();
        for (row, column) in UPPER_TRIANGLE {
            covariance[(row, column)] = reader.f32()?;
            covariance[(column, row)] = covariance[(row, column)];
        }
        points.push(MapPoint { position, covariance });
    }
    let sigma_px = reader.f64()?;
    if sigma_px <= 0.0 {
        return Err(reader.damaged());
    }
    let num_cameras = reader.count(MIN_CAMERA_BYTES)?;
    let mut cameras = Vec::with_capacity(num_cameras);
    for _ in 0..num_cameras {
        cameras.push(read_camera(&mut reader)?);
    }
    let num_images = reader.count(MIN_IMAGE_BYTES)?;
    let mut images = Vec::with_capacity(num_images);
    for _ in 0..num_images {
        images.push(read_image(&mut reader, num_points, num_cameras)?);
    }
    if !reader.is_at_end() {
        return Err(reader.damaged());
    }
    Ok(LocalizationIndex::from_parts(points, images, cameras, sigma_px))
}

fn read_camera(reader: &mut ByteReader) -> Result<Camera, IndexError> {
    let id = reader.u32()?;
    let model = CameraModel::ALL.into_iter().find(|model| model.colmap_id() as u32 == id);
    let (width, height) = (reader.u32()?, reader.u32()?);
    let mut params = vec![0.0; reader.count(8)?];
    for value in &mut params {
        *value = reader.f64()?;
    }
    let camera = model.and_then(|model| Camera::new(model, width, height, &params).ok());
    camera.ok_or(reader.damaged())
}

fn read_image(
    reader: &mut ByteReader,
    num_points: usize,
    num_cameras: usize,
) -> Result<MapImage, IndexError> {
    let [x, y, z, w] = [reader.f64()?, reader.f64()?, reader.f64()?, reader.f64()?];
    let quaternion = Quaternion::new(w, x, y, z);
    if (quaternion.norm_squared() - 1.0).abs() > 1e-6 {
        return Err(reader.damaged());
    }
    let translation = Translation3::new(reader.f64()?, reader.f64()?, reader.f64()?);
    // Kept as written: normalizing again would change its last bits.
    let rotation = UnitQuaternion::new_unchecked(quaternion);
    let camera = reader.u32()?;
    if camera as usize >= num_cameras {
        return Err(reader.damaged());
    }
    let mut modes = vec![Vector6::zeros(); reader.count(6 * 4)?];
    for value in modes.iter_mut().flat_map(|mode| mode.iter_mut()) {
        *value = reader.f32()?;
    }
    let mut global = vec![0.0; reader.count(4)?];
    for value in &mut global {
        *value = reader.f32()?;
    }
    let num_rows = reader.count(ROW_BYTES)?;
    let mut points = Vec::with_capacity(num_rows);
    for _ in 0..num_rows {
        let point = reader.u32()?;
        if point as usize >= num_points {
            return Err(reader.damaged());
        }
        points.push(point);
    }
    let (rows, _) = reader.take(num_rows * DESCRIPTOR_LEN)?.as_chunks::<DESCRIPTOR_LEN>();
    let descriptors: Vec<Descriptor> = rows.to_vec();
    let pose = Isometry3::from_parts(translation, rotation);
    Ok(MapImage::new(pose, camera, PoseNoise(modes), GlobalDescriptor(global), points, descriptors))
}
