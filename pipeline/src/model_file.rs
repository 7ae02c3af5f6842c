//! A reconstruction as bytes, exactly: what mapping made, kept until the map is written.

use nalgebra::{Isometry3, Point2, Point3, Quaternion, UnitQuaternion};
use volery_geometry::{Camera, CameraModel};
use volery_scene::{
    CameraId, ImageId, Observation, Point3d, PointId, Quality, RegisteredImage, SparseModel,
    UnplacedImage,
};
use volery_sfm::Reconstruction;

/// Names of the mappers; the file holds the position.
const MAPPERS: [&str; 2] = ["incremental", "global"];

/// No point behind a keypoint.
const NO_POINT: u64 = u64::MAX;

/// The bytes of a reconstruction.
pub(crate) fn write_reconstruction(
    reconstruction: &Reconstruction,
) -> Result<Vec<u8>, serde_json::Error> {
    let mut out = Writer(Vec::new());
    let mapper = MAPPERS.iter().position(|m| *m == reconstruction.mapper);
    out.u64(mapper.unwrap_or(0) as u64);
    out.bytes(&serde_json::to_vec(&(&reconstruction.unplaced, &reconstruction.quality))?);
    out.u64(reconstruction.models.len() as u64);
    reconstruction.models.iter().for_each(|model| write_model(model, &mut out));
    Ok(out.0)
}

/// The inverse of [`write_reconstruction`]; `None` for other bytes.
pub(crate) fn read_reconstruction(bytes: &[u8]) -> Option<Reconstruction> {
    let mut input = Reader(bytes);
    let mapper = *MAPPERS.get(input.u64()? as usize)?;
    let (unplaced, quality): (Vec<UnplacedImage>, Quality) =
        serde_json::from_slice(input.bytes()?).ok()?;
    let models = input.list(|input| read_model(input))?;
    Some(Reconstruction { models, unplaced, quality, mapper })
}

fn write_model(model: &SparseModel, out: &mut Writer) {
    out.u64(model.cameras.len() as u64);
    for (id, camera) in &model.cameras {
        out.u64(id.0.into());
        out.u64(camera.model.colmap_id() as u64);
        out.u64(camera.width.into());
        out.u64(camera.height.into());
        camera.params().iter().for_each(|p| out.f64(*p));
    }
    out.u64(model.images.len() as u64);
    for (id, image) in &model.images {
        out.u64(id.0.into());
        out.bytes(image.name.as_bytes());
        out.u64(image.camera.0.into());
        let pose = &image.cam_from_world;
        pose.rotation.coords.iter().chain(&pose.translation.vector).for_each(|v| out.f64(*v));
        out.u64(image.keypoints.len() as u64);
        for (keypoint, point) in image.keypoints.iter().zip(&image.points) {
            out.f64(keypoint.x);
            out.f64(keypoint.y);
            out.u64(point.map_or(NO_POINT, |id| id.0));
        }
    }
    out.u64(model.points.len() as u64);
    for (id, point) in &model.points {
        out.u64(id.0);
        point.position.iter().for_each(|v| out.f64(*v));
        out.f64(point.error_px);
        let [r, g, b] = point.color;
        out.u64(u64::from_le_bytes([r, g, b, 0, 0, 0, 0, 0]));
        out.u64(point.track.len() as u64);
        for observation in &point.track {
            out.u64(u64::from(observation.image.0) << 32 | u64::from(observation.keypoint));
        }
    }
}

fn read_model(input: &mut Reader<'_>) -> Option<SparseModel> {
    let cameras = input.list(|input| {
        let id = CameraId(input.u32()?);
        let number = input.u64()? as i32;
        let model = CameraModel::ALL.into_iter().find(|m| m.colmap_id() == number)?;
        let (width, height) = (input.u32()?, input.u32()?);
        let params = (0..model.num_params()).map(|_| input.f64()).collect::<Option<Vec<_>>>()?;
        Some((id, Camera::new(model, width, height, &params).ok()?))
    })?;
    let images = input.list(|input| {
        let id = ImageId(input.u32()?);
        let name = String::from_utf8(input.bytes()?.to_vec()).ok()?;
        let camera = CameraId(input.u32()?);
        let [i, j, k, w] = input.f64s()?;
        let [x, y, z] = input.f64s()?;
        // Normalizing again would move the last bit.
        let rotation = UnitQuaternion::new_unchecked(Quaternion::new(w, i, j, k));
        let cam_from_world = Isometry3::from_parts([x, y, z].into(), rotation);
        let (keypoints, points) = input
            .list(|input| {
                let [x, y] = input.f64s()?;
                let point = input.u64()?;
                Some((Point2::new(x, y), (point != NO_POINT).then_some(PointId(point))))
            })?
            .into_iter()
            .unzip();
        Some((id, RegisteredImage { name, camera, cam_from_world, keypoints, points }))
    })?;
    let points = input.list(|input| {
        let id = PointId(input.u64()?);
        let position = Point3::from(input.f64s::<3>()?);
        let error_px = input.f64()?;
        let [r, g, b, ..] = input.u64()?.to_le_bytes();
        let track = input.list(|input| {
            let packed = input.u64()?;
            let image = ImageId((packed >> 32) as u32);
            Some(Observation { image, keypoint: packed as u32 })
        })?;
        Some((id, Point3d { position, color: [r, g, b], error_px, track }))
    })?;
    Some(SparseModel {
        cameras: cameras.into_iter().collect(),
        images: images.into_iter().collect(),
        points: points.into_iter().collect(),
    })
}

struct Writer(Vec<u8>);

impl Writer {
    fn u64(&mut self, value: u64) {
        self.0.extend(value.to_le_bytes());
    }

    fn f64(&mut self, value: f64) {
        self.u64(value.to_bits());
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.u64(bytes.len() as u64);
        self.0.extend(bytes);
    }
}

struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn u64(&mut self) -> Option<u64> {
        let (head, rest) = self.0.split_first_chunk::<8>()?;
        self.0 = rest;
        Some(u64::from_le_bytes(*head))
    }

    fn u32(&mut self) -> Option<u32> {
        self.u64()?.try_into().ok()
    }

    fn f64(&mut self) -> Option<f64> {
        self.u64().map(f64::from_bits)
    }

    fn f64s<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Some(values)
    }

    fn bytes(&mut self) -> Option<&'a [u8]> {
        let len = self.u64()?.try_into().ok()?;
        let (head, rest) = self.0.split_at_checked(len)?;
        self.0 = rest;
        Some(head)
    }

    /// A count and as many items; every item takes at least 8 bytes.
    fn list<T>(&mut self, mut item: impl FnMut(&mut Self) -> Option<T>) -> Option<Vec<T>> {
        let len = usize::try_from(self.u64()?).ok().filter(|n| *n <= self.0.len() / 8)?;
        (0..len).map(|_| item(self)).collect()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use nalgebra::Vector3;
    use volery_scene::{UnplacedReason, Verdict};

    use super::*;

    fn reconstruction() -> Reconstruction {
        let camera =
            Camera::new(CameraModel::Radial, 640, 480, &[500.1, 320.0, 240.0, 0.1, -0.2]).unwrap();
        let image = RegisteredImage {
            name: "a b.jpg".to_owned(),
            camera: CameraId(0),
            cam_from_world: Isometry3::new(
                Vector3::new(0.1, -2.0, 1e-17),
                Vector3::new(1.0, 2.0, 0.3),
            ),
            keypoints: vec![Point2::new(0.1, 0.2), Point2::new(1.0 / 3.0, 7.0)],
            points: vec![None, Some(PointId(7))],
        };
        let point = Point3d {
            position: Point3::new(1.0, 2.0, -0.1),
            color: [1, 2, 255],
            error_px: 0.7,
            track: vec![Observation { image: ImageId(3), keypoint: 1 }],
        };
        Reconstruction {
            models: vec![SparseModel {
                cameras: BTreeMap::from([(CameraId(0), camera)]),
                images: BTreeMap::from([(ImageId(3), image)]),
                points: BTreeMap::from([(PointId(7), point)]),
            }],
            unplaced: vec![UnplacedImage { image: ImageId(0), reason: UnplacedReason::NoParallax }],
            quality: Quality { verdict: Verdict::Suspect, reasons: Vec::new() },
            mapper: "global",
        }
    }

    #[test]
    fn every_bit_comes_back() {
        let bytes = write_reconstruction(&reconstruction()).unwrap();
        assert_eq!(read_reconstruction(&bytes), Some(reconstruction()));
    }

    #[test]
    fn no_cut_is_a_reconstruction() {
        let bytes = write_reconstruction(&reconstruction()).unwrap();
        for len in 0..bytes.len() {
            assert_eq!(read_reconstruction(&bytes[..len]), None, "{len} bytes");
        }
    }
}
