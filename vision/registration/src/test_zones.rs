//! Zones with truth.

use nalgebra::{Isometry3, Point3, Similarity3, Translation3, UnitQuaternion, Vector3};
use volery_geometry::Rng;
use volery_scene::{OrientedPoint, PointCloud};
use volery_synthetic::{Room, ScanOptions, Zone as Scan};

use crate::Zone;

/// Detail of rooms, meters.
pub(crate) const CELL: f64 = 0.05;

/// All of a room.
pub(crate) fn whole(room: &Room, num_points: usize, seed: u64) -> Scan {
    let half = room.size / 2.0;
    let low = Point3::new(-half.x, -half.y, 0.0) - Vector3::repeat(1e-6);
    let high = Point3::new(half.x, half.y, room.size.z) + Vector3::repeat(1e-6);
    room.scan(low, high, &ScanOptions { num_points, ..Default::default() }, seed)
}

/// A scan in another frame.
pub(crate) fn moved(scan: &Scan, zone_from_room: &Similarity3<f64>) -> Scan {
    let rotation = zone_from_room.isometry.rotation;
    let turn = |p: &OrientedPoint| OrientedPoint {
        position: (zone_from_room * p.position.cast::<f64>()).cast(),
        normal: (rotation * p.normal.cast::<f64>()).cast(),
        ..*p
    };
    Scan {
        cloud: PointCloud { points: scan.cloud.points.iter().map(turn).collect() },
        viewpoints: scan.viewpoints.iter().map(|v| zone_from_room * v).collect(),
    }
}

/// Anywhere within some ten meters, turned any way.
pub(crate) fn random_frame(rng: &mut Rng) -> Similarity3<f64> {
    let quaternion =
        nalgebra::Quaternion::new(rng.normal(), rng.normal(), rng.normal(), rng.normal());
    let rotation = UnitQuaternion::from_quaternion(quaternion);
    let translation = Translation3::from(rng.normal3() * 10.0);
    Similarity3::from_isometry(Isometry3::from_parts(translation, rotation), 1.0)
}

pub(crate) fn zone(scan: &Scan) -> Zone {
    Zone::new(&scan.cloud, &scan.viewpoints, CELL).unwrap()
}

/// How far a transform moves a point that the truth leaves where it is: shift and turn (radians).
pub(crate) fn off(
    found: &Similarity3<f64>,
    truth: &Similarity3<f64>,
    at: &Point3<f64>,
) -> (f64, f64) {
    let angle = found.isometry.rotation.angle_to(&truth.isometry.rotation);
    ((found * at - truth * at).norm(), angle)
}
