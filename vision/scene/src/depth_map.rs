//! What one image knows of the surfaces in front of it.

use nalgebra::{Isometry3, Point2, Point3, Vector3};
use volery_geometry::Camera;

use crate::ImageId;

/// Depth, normal and confidence of every pixel of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthMap {
    /// Whose pixels these are.
    pub image: ImageId,
    /// Intrinsics of the map: a pinhole camera of the map's size.
    pub camera: Camera,
    /// Pose.
    pub cam_from_world: Isometry3<f64>,
    /// Depth along the camera's z at the pixel centers, row by row; 0 where nothing is known.
    pub depth: Vec<f32>,
    /// Surface normals in the camera frame, towards the camera.
    pub normals: Vec<OctNormal>,
    /// From 0 (nothing is known) to 255.
    pub confidence: Vec<u8>,
    /// Whether the depth was concluded from the surroundings and not seen.
    pub inferred: Vec<bool>,
}

impl DepthMap {
    /// A map that knows nothing.
    pub fn empty(image: ImageId, camera: Camera, cam_from_world: Isometry3<f64>) -> Self {
        let num_pixels = camera.width as usize * camera.height as usize;
        Self {
            image,
            camera,
            cam_from_world,
            depth: vec![0.0; num_pixels],
            normals: vec![OctNormal::default(); num_pixels],
            confidence: vec![0; num_pixels],
            inferred: vec![false; num_pixels],
        }
    }

    /// Pixels per row.
    pub fn width(&self) -> usize {
        self.camera.width as usize
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.camera.height as usize
    }

    /// Center of the pixel at `index`.
    pub fn pixel(&self, index: usize) -> Point2<f64> {
        let (x, y) = (index % self.width(), index / self.width());
        Point2::new(x as f64 + 0.5, y as f64 + 0.5)
    }

    /// Index of the pixel in which an image position falls.
    pub fn index_at(&self, pixel: &Point2<f64>) -> Option<usize> {
        self.camera.contains(pixel).then(|| pixel.y as usize * self.width() + pixel.x as usize)
    }

    /// The surface point of a pixel in the camera frame, `None` where nothing is known.
    pub fn point_in_cam(&self, index: usize) -> Option<Point3<f64>> {
        let depth = f64::from(self.depth[index]);
        if depth <= 0.0 {
            return None;
        }
        let xy = self.camera.unproject(&self.pixel(index))?;
        Some(Point3::new(xy.x * depth, xy.y * depth, depth))
    }

    /// Number of pixels with a depth.
    pub fn num_known(&self) -> usize {
        self.depth.iter().filter(|&&depth| depth > 0.0).count()
    }

    /// Forgets a pixel.
    pub fn clear(&mut self, index: usize) {
        self.depth[index] = 0.0;
        self.normals[index] = OctNormal::default();
        self.confidence[index] = 0;
        self.inferred[index] = false;
    }
}

/// A unit vector in four bytes: the octahedron |x| + |y| + |z| = 1 unfolded onto a square.
///
/// The angle to the vector it was made of stays below 0.005 degrees.
///
/// Source: Meyer et al., "On Floating-Point Normal Vectors", EGSR 2010.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OctNormal([i16; 2]);

impl OctNormal {
    /// Little endian.
    pub fn to_bytes(self) -> [u8; 4] {
        let [[a, b], [c, d]] = self.0.map(i16::to_le_bytes);
        [a, b, c, d]
    }

    /// The inverse of [`Self::to_bytes`].
    pub fn from_bytes([a, b, c, d]: [u8; 4]) -> Self {
        Self([[a, b], [c, d]].map(i16::from_le_bytes))
    }
}

impl From<Vector3<f32>> for OctNormal {
    fn from(n: Vector3<f32>) -> Self {
        let p = n / (n.x.abs() + n.y.abs() + n.z.abs());
        let [x, y] = if p.z < 0.0 { fold(p.x, p.y) } else { [p.x, p.y] };
        let max = f32::from(i16::MAX);
        Self([(x * max).round() as i16, (y * max).round() as i16])
    }
}

impl From<OctNormal> for Vector3<f32> {
    fn from(OctNormal(packed): OctNormal) -> Self {
        let [x, y] = packed.map(|v| f32::from(v) / f32::from(i16::MAX));
        let z = 1.0 - x.abs() - y.abs();
        let [x, y] = if z < 0.0 { fold(x, y) } else { [x, y] };
        Self::new(x, y, z).normalize()
    }
}

/// Swaps the middle of the square with its corners.
fn fold(x: f32, y: f32) -> [f32; 2] {
    [(1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y)]
}

#[cfg(test)]
mod tests {
    use volery_geometry::{CameraModel, Rng};

    use super::*;

    #[test]
    fn packed_normals_stay_where_they_point() {
        let mut rng = Rng::new(7);
        for _ in 0..2000 {
            let normal = rng.normal3().normalize().cast::<f32>();
            let back = Vector3::from(OctNormal::from(normal));
            let packed = OctNormal::from(normal);
            assert_eq!(OctNormal::from_bytes(packed.to_bytes()), packed);
            assert!(normal.cross(&back).norm() < 8e-5 && normal.dot(&back) > 0.0, "{normal}");
        }
    }

    #[test]
    fn a_pixel_and_its_point_see_each_other() {
        let camera = Camera::from_focal(CameraModel::Pinhole, 8, 6, 7.0).unwrap();
        let mut map = DepthMap::empty(ImageId(0), camera, Isometry3::identity());
        assert_eq!((map.num_known(), map.point_in_cam(13)), (0, None));
        map.depth[13] = 2.0;
        let point = map.point_in_cam(13).unwrap();
        assert_eq!(map.index_at(&camera.project(&point).unwrap()), Some(13));
        assert_eq!(map.index_at(&Point2::new(8.0, 1.0)), None);
    }
}
