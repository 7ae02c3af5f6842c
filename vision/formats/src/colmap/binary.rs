//! The binary form, little endian.

use volery_geometry::CameraModel;
use volery_scene::SparseModel;

use super::build::{Builder, ImageRecord, Place, PointRecord};
use super::{ColmapError, ColmapFile, ColmapFiles, clean_name};
use crate::bytes::{ByteReader, OutOfBytes};

/// Written for a keypoint that sees no point.
const NO_POINT: u64 = u64::MAX;

const MIN_CAMERA_BYTES: usize = 4 + 4 + 8 + 8 + 3 * 8;
const MIN_IMAGE_BYTES: usize = 4 + 7 * 8 + 4 + 1 + 8;
const KEYPOINT_BYTES: usize = 8 + 8 + 8;
const MIN_POINT_BYTES: usize = 8 + 3 * 8 + 3 + 8 + 8;
const TRACK_ELEMENT_BYTES: usize = 4 + 4;

/// Writes the binary form; camera, image and point ids are written plus one.
pub fn write_colmap_binary(model: &SparseModel) -> ColmapFiles {
    let mut files = ColmapFiles::default();
    let out = &mut files.cameras;
    out.extend((model.cameras.len() as u64).to_le_bytes());
    for (id, camera) in &model.cameras {
        out.extend((id.0 + 1).to_le_bytes());
        out.extend(camera.model.colmap_id().to_le_bytes());
        out.extend(u64::from(camera.width).to_le_bytes());
        out.extend(u64::from(camera.height).to_le_bytes());
        out.extend(camera.params().iter().flat_map(|p| p.to_le_bytes()));
    }

    let out = &mut files.images;
    out.extend((model.images.len() as u64).to_le_bytes());
    for (id, image) in &model.images {
        out.extend((id.0 + 1).to_le_bytes());
        let q = image.cam_from_world.rotation.quaternion();
        let t = &image.cam_from_world.translation.vector;
        out.extend([q.w, q.i, q.j, q.k, t.x, t.y, t.z].iter().flat_map(|v| v.to_le_bytes()));
        out.extend((image.camera.0 + 1).to_le_bytes());
        out.extend(clean_name(&image.name).bytes());
        out.push(0);
        out.extend((image.keypoints.len() as u64).to_le_bytes());
        for (keypoint, point) in image.keypoints.iter().zip(&image.points) {
            out.extend(keypoint.x.to_le_bytes());
            out.extend(keypoint.y.to_le_bytes());
            out.extend(point.map_or(NO_POINT, |point| point.0 + 1).to_le_bytes());
        }
    }

    let out = &mut files.points;
    out.extend((model.points.len() as u64).to_le_bytes());
    for (id, point) in &model.points {
        out.extend((id.0 + 1).to_le_bytes());
        out.extend(point.position.iter().flat_map(|v| v.to_le_bytes()));
        out.extend(point.color);
        out.extend(point.error_px.to_le_bytes());
        out.extend((point.track.len() as u64).to_le_bytes());
        for observation in &point.track {
            out.extend((observation.image.0 + 1).to_le_bytes());
            out.extend(observation.keypoint.to_le_bytes());
        }
    }
    files
}

/// Reads the binary form.
///
/// # Errors
///
/// [`ColmapError`] for files that are cut off, senseless, or contradict each other.
pub fn read_colmap_binary(files: &ColmapFiles) -> Result<SparseModel, ColmapError> {
    let mut builder = Builder::default();
    read_cameras_and_images(files, &mut builder)?;
    read_records(ColmapFile::Points, &files.points, MIN_POINT_BYTES, |place, reader| {
        let id = reader.u64()?;
        let position = [reader.f64()?, reader.f64()?, reader.f64()?];
        let color = [reader.u8()?, reader.u8()?, reader.u8()?];
        let error_px = reader.f64()?;
        let length = reader.count(TRACK_ELEMENT_BYTES)?;
        let mut track = Vec::with_capacity(length);
        for _ in 0..length {
            track.push((u64::from(reader.u32()?), reader.u32()?));
        }
        Ok(builder.point(place, PointRecord { id, position, color, error_px, track })?)
    })?;
    builder.finish()
}

pub(super) fn read_cameras_and_images(
    files: &ColmapFiles,
    builder: &mut Builder,
) -> Result<(), ColmapError> {
    read_records(ColmapFile::Cameras, &files.cameras, MIN_CAMERA_BYTES, |place, reader| {
        let id = u64::from(reader.u32()?);
        let model_id = reader.i32()?;
        let model = CameraModel::ALL
            .into_iter()
            .find(|model| model.colmap_id() == model_id)
            .ok_or_else(|| place.invalid(format!("camera model {model_id} is not known")))?;
        let size = (reader.u64()?, reader.u64()?);
        let mut params = Vec::with_capacity(model.num_params());
        for _ in 0..model.num_params() {
            params.push(reader.f64()?);
        }
        Ok(builder.camera(place, id, model, size, &params)?)
    })?;
    read_records(ColmapFile::Images, &files.images, MIN_IMAGE_BYTES, |place, reader| {
        let id = u64::from(reader.u32()?);
        let quaternion = [reader.f64()?, reader.f64()?, reader.f64()?, reader.f64()?];
        let translation = [reader.f64()?, reader.f64()?, reader.f64()?];
        let camera = u64::from(reader.u32()?);
        let name = String::from_utf8_lossy(reader.zero_terminated()?).into_owned();
        let num_keypoints = reader.count(KEYPOINT_BYTES)?;
        let mut keypoints = Vec::with_capacity(num_keypoints);
        for _ in 0..num_keypoints {
            let (x, y, point) = (reader.f64()?, reader.f64()?, reader.u64()?);
            keypoints.push((x, y, (point != NO_POINT).then_some(point)));
        }
        let record = ImageRecord { id, quaternion, translation, camera, name, keypoints };
        Ok(builder.image(place, record)?)
    })
}

/// An error inside a record.
enum RecordError {
    OutOfBytes(OutOfBytes),
    Colmap(ColmapError),
}

impl From<OutOfBytes> for RecordError {
    fn from(error: OutOfBytes) -> Self {
        Self::OutOfBytes(error)
    }
}

impl From<ColmapError> for RecordError {
    fn from(error: ColmapError) -> Self {
        Self::Colmap(error)
    }
}

/// Calls `read` for each record of a file that begins with their number.
fn read_records(
    file: ColmapFile,
    bytes: &[u8],
    min_record_bytes: usize,
    mut read: impl FnMut(Place, &mut ByteReader) -> Result<(), RecordError>,
) -> Result<(), ColmapError> {
    let truncated = |OutOfBytes { offset }| ColmapError::Truncated { file, offset };
    let mut reader = ByteReader::new(bytes);
    let num_records = reader.count(min_record_bytes).map_err(truncated)?;
    for record in 1..=num_records {
        read(Place { file, record }, &mut reader).map_err(|error| match error {
            RecordError::OutOfBytes(error) => truncated(error),
            RecordError::Colmap(error) => error,
        })?;
    }
    if reader.is_at_end() {
        Ok(())
    } else {
        Err(Place { file, record: num_records }.invalid("bytes follow the last record"))
    }
}
