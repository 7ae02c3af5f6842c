//! Oriented points as PLY, with all that is known of them.

use nalgebra::{Point3, Vector3};
use volery_scene::{OrientedPoint, PointCloud};

use super::{PlyCloud, PlyError, read_header};

/// Writes binary little endian: x, y, z, nx, ny, nz as 32-bit floats, red, green, blue,
/// confidence, and inferred as 0 or 1.
pub fn write_ply_of_cloud(cloud: &PointCloud) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float \
         y\nproperty float z\nproperty float nx\nproperty float ny\nproperty float nz\nproperty \
         uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar \
         confidence\nproperty uchar inferred\nend_header\n",
        cloud.points.len()
    )
    .into_bytes();
    bytes.reserve(cloud.points.len() * 29);
    for point in &cloud.points {
        let numbers = point.position.iter().chain(point.normal.iter());
        bytes.extend(numbers.flat_map(|v| v.to_le_bytes()));
        bytes.extend(point.color);
        bytes.extend([point.confidence, u8::from(point.inferred)]);
    }
    bytes
}

/// Reads points with normals from any PLY. Where a file does not tell, points are white, wholly
/// trusted and seen.
///
/// # Errors
///
/// As [`super::read_ply`], and [`PlyError::Header`] without normals.
pub fn read_ply_of_cloud(bytes: &[u8]) -> Result<PointCloud, PlyError> {
    let (layout, data) = read_header(bytes)?;
    if layout.normal.is_none() {
        return Err(PlyError::Header("vertices have no normals".to_owned()));
    }
    let find = |name: &str| layout.properties.iter().position(|(property, _)| property == name);
    let (confidence, inferred) = (find("confidence"), find("inferred"));
    let mut cloud = PointCloud::default();
    let mut one = PlyCloud::default();
    let mut index = 0;
    layout.each_vertex(data, &mut |values| {
        let not_a_number = |_| PlyError::NotANumber { vertex: index };
        layout.push(&mut one, values).map_err(not_a_number)?;
        index += 1;
        cloud.points.push(OrientedPoint {
            position: one.points.pop().unwrap_or_else(Point3::origin).cast(),
            normal: one.normals.pop().unwrap_or_else(Vector3::zeros),
            color: one.colors.pop().unwrap_or_default(),
            confidence: confidence.map_or(u8::MAX, |i| values[i] as u8),
            inferred: inferred.is_some_and(|i| values[i] != 0.0),
        });
        Ok(())
    })?;
    Ok(cloud)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud() -> PointCloud {
        let point = |x: f32, inferred| OrientedPoint {
            position: Point3::new(x, -1.25, 3.0),
            normal: Vector3::new(0.0, 0.6, -0.8),
            color: [0, 127, 255],
            confidence: 77,
            inferred,
        };
        PointCloud { points: vec![point(0.1, false), point(-2.5, true)] }
    }

    #[test]
    fn everything_comes_back() {
        assert_eq!(read_ply_of_cloud(&write_ply_of_cloud(&cloud())), Ok(cloud()));
        let empty = PointCloud::default();
        assert_eq!(read_ply_of_cloud(&write_ply_of_cloud(&empty)), Ok(empty));
    }

    #[test]
    fn every_truncation_and_every_lie_is_an_error() {
        let whole = write_ply_of_cloud(&cloud());
        for end in 0..whole.len() {
            assert!(read_ply_of_cloud(&whole[..end]).is_err(), "cut at {end}");
        }
        let mut second_is_nan = whole.clone();
        let last = whole.len() - 29;
        second_is_nan[last..last + 4].copy_from_slice(&f32::NAN.to_le_bytes());
        assert_eq!(read_ply_of_cloud(&second_is_nan), Err(PlyError::NotANumber { vertex: 1 }));
        let bare = super::super::write_ply(&PlyCloud::default());
        assert!(matches!(read_ply_of_cloud(&bare), Err(PlyError::Header(_))));
    }
}
