//! Checked assembly of a model from records of either form.

use nalgebra::{Isometry3, Point2, Point3, Quaternion, Translation3, UnitQuaternion};
use volery_geometry::{Camera, CameraModel};
use volery_scene::{
    CameraId, ImageId, Observation, Point3d, PointId, RegisteredImage, SparseModel,
};

use super::{ColmapError, ColmapFile};

/// Where an error is reported.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    pub(super) file: ColmapFile,
    pub(super) record: usize,
}

impl Place {
    pub(super) fn invalid(self, detail: impl Into<String>) -> ColmapError {
        ColmapError::Invalid { file: self.file, record: self.record, detail: detail.into() }
    }

    fn finite(self, numbers: &[f64]) -> Result<(), ColmapError> {
        if numbers.iter().all(|number| number.is_finite()) {
            Ok(())
        } else {
            Err(self.invalid("a number is not finite"))
        }
    }

    fn u32_id(self, written: u64) -> Result<u32, ColmapError> {
        let id = written.checked_sub(1).and_then(|id| u32::try_from(id).ok());
        id.ok_or_else(|| self.invalid(format!("id {written} is out of range")))
    }
}

/// The fields of an image record.
pub(super) struct ImageRecord {
    pub(super) id: u64,
    /// w, x, y, z.
    pub(super) quaternion: [f64; 4],
    pub(super) translation: [f64; 3],
    pub(super) camera: u64,
    pub(super) name: String,
    /// x, y and the id of the point, if it sees one.
    pub(super) keypoints: Vec<(f64, f64, Option<u64>)>,
}

/// The fields of a point record.
pub(super) struct PointRecord {
    pub(super) id: u64,
    pub(super) position: [f64; 3],
    pub(super) color: [u8; 3],
    pub(super) error_px: f64,
    /// Image id and keypoint index.
    pub(super) track: Vec<(u64, u32)>,
}

#[derive(Default)]
pub(super) struct Builder {
    model: SparseModel,
    /// Keypoints are left out, and with them who sees which point.
    poses_only: bool,
}

impl Builder {
    pub(super) fn of_poses() -> Self {
        Self { poses_only: true, ..Self::default() }
    }

    pub(super) fn camera(
        &mut self,
        place: Place,
        id: u64,
        model: CameraModel,
        size: (u64, u64),
        params: &[f64],
    ) -> Result<(), ColmapError> {
        let id = CameraId(place.u32_id(id)?);
        let (Ok(width), Ok(height)) = (u32::try_from(size.0), u32::try_from(size.1)) else {
            return Err(place.invalid(format!("image size {} x {}", size.0, size.1)));
        };
        let camera = Camera::new(model, width, height, params)
            .map_err(|error| place.invalid(error.to_string()))?;
        match self.model.cameras.insert(id, camera) {
            None => Ok(()),
            Some(_) => Err(place.invalid("the camera comes twice")),
        }
    }

    pub(super) fn image(&mut self, place: Place, record: ImageRecord) -> Result<(), ColmapError> {
        let id = ImageId(place.u32_id(record.id)?);
        let camera = CameraId(place.u32_id(record.camera)?);
        if !self.model.cameras.contains_key(&camera) {
            let (file, id) = (place.file, record.camera);
            return Err(ColmapError::Dangling { file, what: "camera", id });
        }
        let [w, x, y, z] = record.quaternion;
        place.finite(&record.quaternion)?;
        place.finite(&record.translation)?;
        let quaternion = Quaternion::new(w, x, y, z);
        if quaternion.norm() < 1e-3 {
            return Err(place.invalid("the quaternion is zero"));
        }
        let sightings = if self.poses_only { Vec::new() } else { record.keypoints };
        let mut keypoints = Vec::with_capacity(sightings.len());
        let mut points = Vec::with_capacity(sightings.len());
        for (x, y, point) in sightings {
            place.finite(&[x, y])?;
            keypoints.push(Point2::new(x, y));
            points.push(match point {
                None => None,
                Some(0) => return Err(place.invalid("point id 0")),
                Some(written) => Some(PointId(written - 1)),
            });
        }
        let image = RegisteredImage {
            name: record.name,
            camera,
            cam_from_world: Isometry3::from_parts(
                Translation3::from(nalgebra::Vector3::from(record.translation)),
                UnitQuaternion::from_quaternion(quaternion),
            ),
            keypoints,
            points,
        };
        match self.model.images.insert(id, image) {
            None => Ok(()),
            Some(_) => Err(place.invalid("the image comes twice")),
        }
    }

    pub(super) fn point(&mut self, place: Place, record: PointRecord) -> Result<(), ColmapError> {
        let id = record.id.checked_sub(1).ok_or_else(|| place.invalid("point id 0"))?;
        place.finite(&record.position)?;
        place.finite(&[record.error_px])?;
        let mut track = Vec::with_capacity(record.track.len());
        for (image, keypoint) in record.track {
            track.push(Observation { image: ImageId(place.u32_id(image)?), keypoint });
        }
        track.sort_unstable();
        let point = Point3d {
            position: Point3::from(record.position),
            color: record.color,
            error_px: record.error_px,
            track,
        };
        match self.model.points.insert(PointId(id), point) {
            None => Ok(()),
            Some(_) => Err(place.invalid("the point comes twice")),
        }
    }

    /// The model, if images and points agree on who sees what.
    pub(super) fn finish(self) -> Result<SparseModel, ColmapError> {
        let model = self.model;
        let mut num_confirmed = 0;
        for (id, point) in &model.points {
            for observation in &point.track {
                let image = model.images.get(&observation.image);
                let seen = image.and_then(|i| i.points.get(observation.keypoint as usize));
                if seen != Some(&Some(*id)) {
                    let id = u64::from(observation.image.0) + 1;
                    let file = ColmapFile::Points;
                    return Err(ColmapError::Dangling { file, what: "image", id });
                }
                num_confirmed += 1;
            }
            if point.track.windows(2).any(|pair| pair[0] == pair[1]) {
                let (file, id) = (ColmapFile::Points, id.0 + 1);
                return Err(ColmapError::Dangling { file, what: "doubled track element of", id });
            }
        }
        let sightings = || model.images.values().flat_map(|i| &i.points).flatten();
        if sightings().count() != num_confirmed {
            // Rare and wrong already: find the one to blame.
            let lost = model.images.iter().find_map(|(image_id, image)| {
                image.points.iter().enumerate().find_map(|(keypoint, point)| {
                    let point = (*point)?;
                    let sighting = Observation { image: *image_id, keypoint: keypoint as u32 };
                    let known = model.points.get(&point);
                    (!known.is_some_and(|p| p.track.contains(&sighting))).then_some(point.0)
                })
            });
            let id = lost.map_or(0, |id| id.saturating_add(1));
            return Err(ColmapError::Dangling { file: ColmapFile::Images, what: "point", id });
        }
        Ok(model)
    }
}
