//! What a drone can run into.

use nalgebra::{Point3, Vector3};
use volery_synthetic::Room;

/// The solid part of the world; its floor is at z = 0.
#[derive(Debug, Clone, PartialEq)]
pub enum Space {
    /// A floor without walls.
    Open,
    /// A room with things in it.
    Room(Room),
    /// An empty box from its lowest to its highest corner.
    Hollow([Point3<f64>; 2]),
}

impl Space {
    /// Whether a ball of radius `margin` touches nothing.
    pub fn is_free(&self, center: &Point3<f64>, margin: f64) -> bool {
        match self {
            Self::Open => center.z >= margin,
            Self::Room(room) => room.is_free(center, margin),
            Self::Hollow([low, high]) => {
                let inner = Vector3::repeat(margin);
                *center >= low + inner && *center <= high - inner
            }
        }
    }
}
