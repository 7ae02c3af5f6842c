//! `poses.csv`: `image,qw,qx,qy,qz,tx,ty,tz`, camera to world.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};

use crate::TableError;
use crate::table::Table;

/// The pose of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct NamedPose {
    /// File name.
    pub image: String,
    /// The camera's axes (x right, y down, z forward) and center in the world.
    pub world_from_cam: Isometry3<f64>,
}

/// Reads poses. Quaternions are normalized; one far from unit length is refused.
///
/// # Errors
///
/// [`TableError`] with the line of the first field, column or name that is wrong.
pub fn read_poses_csv(bytes: &[u8]) -> Result<Vec<NamedPose>, TableError> {
    let table = Table::parse(bytes)?;
    let images = table.image_names()?;
    let mut columns = [table.required("qw")?; 7];
    for (column, name) in columns.iter_mut().zip(["qw", "qx", "qy", "qz", "tx", "ty", "tz"]) {
        *column = table.required(name)?;
    }
    images
        .into_iter()
        .zip(table.rows())
        .map(|(image, row)| {
            let mut v = [0.0; 7];
            for (value, column) in v.iter_mut().zip(columns) {
                *value = row.number(column)?;
            }
            let quaternion = Quaternion::new(v[0], v[1], v[2], v[3]);
            if (quaternion.norm() - 1.0).abs() > 0.01 {
                return Err(row.out_of_range(columns[0], "the quaternion is not of unit length"));
            }
            let rotation = UnitQuaternion::from_quaternion(quaternion);
            let translation = Translation3::new(v[4], v[5], v[6]);
            Ok(NamedPose { image, world_from_cam: Isometry3::from_parts(translation, rotation) })
        })
        .collect()
}

/// Writes poses in the order given, with `qw >= 0`.
pub fn write_poses_csv(poses: &[NamedPose]) -> String {
    let mut text = String::from("image,qw,qx,qy,qz,tx,ty,tz\n");
    for NamedPose { image, world_from_cam } in poses {
        let q = world_from_cam.rotation.quaternion();
        let q = if q.w < 0.0 { -q } else { *q };
        let t = &world_from_cam.translation.vector;
        text.push_str(&format!(
            "{image},{:.9},{:.9},{:.9},{:.9},{:.7},{:.7},{:.7}\n",
            q.w, q.i, q.j, q.k, t.x, t.y, t.z
        ));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn round_trip() {
        let poses = vec![
            NamedPose {
                image: "a b.jpg".into(),
                world_from_cam: Isometry3::from_parts(
                    Translation3::new(1.0, -2.5, 1e-3),
                    UnitQuaternion::from_euler_angles(0.1, 2.0, -3.0),
                ),
            },
            NamedPose { image: "sub/b.png".into(), world_from_cam: Isometry3::identity() },
        ];
        let read = read_poses_csv(write_poses_csv(&poses).as_bytes()).unwrap();
        assert_eq!(read.len(), 2);
        for (a, b) in poses.iter().zip(&read) {
            assert_eq!(a.image, b.image);
            assert!(a.world_from_cam.rotation.angle_to(&b.world_from_cam.rotation) < 1e-7);
            let (ta, tb) = (a.world_from_cam.translation, b.world_from_cam.translation);
            assert!((ta.vector - tb.vector).norm() < 1e-6);
        }
    }

    #[test]
    fn a_quaternion_has_unit_length() {
        let zero = b"image,qw,qx,qy,qz,tx,ty,tz\na,0,0,0,0,1,2,3\n";
        assert!(matches!(read_poses_csv(zero), Err(TableError::OutOfRange { line: 2, .. })));
    }
}
