//! A partial map as registration sees it.

use nalgebra::Point3;
use volery_scene::PointCloud;

use crate::RegistrationError;
use crate::landmarks::Landmarks;
use crate::seen_space::SeenSpace;
use crate::surfels::Surfels;

/// A zone: its surface, the space that it saw to be free and the places by which it is known.
#[derive(Debug, Clone)]
pub struct Zone {
    surfels: Surfels,
    seen: SeenSpace,
    landmarks: Landmarks,
}

impl Zone {
    /// Of an oriented cloud.
    ///
    /// * `viewpoints`: camera centers, in the frame of the cloud. Without them no space is known
    ///   to be free, and nothing but agreement proves an overlap.
    /// * `cell`: the size of the detail that counts, units of the cloud: 0.05 m for rooms.
    ///
    /// # Errors
    ///
    /// As [`Surfels::new`].
    pub fn new(
        cloud: &PointCloud,
        viewpoints: &[Point3<f64>],
        cell: f64,
    ) -> Result<Self, RegistrationError> {
        if let Some(index) = viewpoints.iter().position(|p| !p.iter().all(|v| v.is_finite())) {
            return Err(RegistrationError::NotFinite { index });
        }
        let surfels = Surfels::new(cloud, cell)?;
        let seen = SeenSpace::new(surfels.pieces(), viewpoints);
        let landmarks = Landmarks::new(&surfels)?;
        Ok(Self { surfels, seen, landmarks })
    }

    /// Its surface.
    pub fn surfels(&self) -> &Surfels {
        &self.surfels
    }

    pub(crate) fn seen(&self) -> &SeenSpace {
        &self.seen
    }

    pub(crate) fn landmarks(&self) -> &Landmarks {
        &self.landmarks
    }
}
