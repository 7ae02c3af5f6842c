//! `poses.csv`: `image,qw,qx,qy,qz,tx,ty,tz`, camera to world.

use nalgebra::Isometry3;

use crate::TableError;

/// The pose of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedPose {
    /// File name.
    pub image: String,
    /// The camera's axes (x right, y down, z forward) and center in the world.
    pub world_from_cam: Isometry3<f64>,
}

/// Reads poses; quaternions are normalized.
pub fn read_poses_csv(bytes: &[u8]) -> Result<Vec<NamedPose>, TableError> {
    let _ = bytes;
    todo!()
}

/// Writes poses in the order given.
pub fn write_poses_csv(poses: &[NamedPose]) -> String {
    let _ = poses;
    todo!()
}
