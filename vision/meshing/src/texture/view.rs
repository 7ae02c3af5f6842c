//! What an image sees of a mesh.

use nalgebra::{Isometry3, Point2, Point3};
use volery_geometry::Camera;
use volery_rendering::{DrawableMesh, VirtualCamera};
use volery_scene::{ImageId, RegisteredImage, TriangleMesh};

/// Pixels of the depth buffer; larger images are judged at this size.
const MAX_BUFFER_PIXELS: f64 = 400_000.0;
/// Surfaces nearer than this are not seen.
const NEAR: f64 = 1e-3;
/// A point is hidden by what is nearer by more than this part of its depth.
const DEPTH_TOLERANCE: f64 = 0.006;
/// Least cosine between the line of sight and the normal.
const MIN_COSINE: f64 = 0.12;
/// Rays beyond the corners of the image by more than this factor are not of it: polynomials of
/// distortion may fold them back.
const RAY_MARGIN: f64 = 1.05;
/// The points of a triangle that must be seen are so far from its corners to its center.
const INSET: f64 = 0.1;

/// An image as a camera in space.
#[derive(Debug, Clone, Copy)]
pub(super) struct View {
    pub(super) image: ImageId,
    pub(super) camera: Camera,
    cam_from_world: Isometry3<f64>,
    /// Greatest |x/z, y/z| of a ray of the image.
    max_slope: f64,
}

impl View {
    pub(super) fn new(image: ImageId, registered: &RegisteredImage, camera: &Camera) -> Self {
        const STEPS: u32 = 32;
        let (w, h) = (f64::from(camera.width), f64::from(camera.height));
        let border = (0..STEPS).flat_map(|i| {
            let t = f64::from(i) / f64::from(STEPS);
            [[t * w, 0.0], [w, t * h], [w - t * w, h], [0.0, h - t * h]].map(Point2::from)
        });
        let slopes = border.filter_map(|pixel| camera.unproject(&pixel)).map(|xy| xy.norm());
        Self {
            image,
            camera: *camera,
            cam_from_world: registered.cam_from_world,
            max_slope: RAY_MARGIN * slopes.fold(0.0, f64::max),
        }
    }

    /// Pixel and depth of a point in front of the camera and within its cone of rays.
    pub(super) fn project(&self, point: &Point3<f64>) -> Option<(Point2<f64>, f64)> {
        self.project_in_cam(&(self.cam_from_world * point))
    }

    fn project_in_cam(&self, p: &Point3<f64>) -> Option<(Point2<f64>, f64)> {
        let reach = self.max_slope * p.z;
        if p.z < NEAR || p.x * p.x + p.y * p.y > reach * reach {
            return None;
        }
        Some((self.camera.project(p)?, p.z))
    }

    /// The triangles that are seen whole, with the number of pixels that they fill, less where they
    /// are seen from the side.
    pub(super) fn seen_triangles(
        &self,
        mesh: &TriangleMesh,
        drawable: &DrawableMesh,
    ) -> Vec<(u32, f32)> {
        let corners: Vec<Corner> = mesh.vertices.iter().map(|v| self.corner(v)).collect();
        let depths = DepthBuffer::draw(self, drawable);
        let seen = |(index, triangle): (usize, &[u32; 3])| {
            let corners = triangle.map(|v| corners[v as usize]);
            Some((index as u32, self.quality(&depths, &corners)?))
        };
        mesh.triangles.iter().enumerate().filter_map(seen).collect()
    }

    fn corner(&self, point: &Point3<f64>) -> Corner {
        let in_cam = self.cam_from_world * point;
        let pixel = self.project_in_cam(&in_cam).map(|(pixel, _)| pixel);
        Corner { in_cam, pixel }
    }

    fn quality(&self, depths: &DepthBuffer, corners: &[Corner; 3]) -> Option<f32> {
        let [p, q, r] = [corners[0].pixel?, corners[1].pixel?, corners[2].pixel?];
        if ![p, q, r].iter().all(|pixel| self.camera.contains(pixel)) {
            return None;
        }
        let [a, b, c] = &corners.map(|corner| corner.in_cam);
        let center = Point3::from((a.coords + b.coords + c.coords) / 3.0);
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0)?;
        // Counterclockwise from outside: the normal looks to the camera, which is the origin.
        let cosine = -normal.dot(&center.coords) / center.coords.norm();
        if cosine < MIN_COSINE {
            return None;
        }
        // Depth changes so much, relative, over a pixel of the buffer.
        let slope = (1.0 - cosine * cosine).sqrt() / cosine * depths.pixel_angle;
        let tolerance = 1.0 + DEPTH_TOLERANCE + slope;
        let inset = |corner: &Point3<f64>| corner + (center - corner) * INSET;
        let middle = |p: &Point3<f64>, q: &Point3<f64>| inset(&nalgebra::center(p, q));
        let points =
            [center, inset(a), inset(b), inset(c), middle(a, b), middle(b, c), middle(c, a)];
        for point in points {
            let (pixel, depth) = self.project_in_cam(&point)?;
            if depth > depths.at(&pixel) * tolerance {
                return None;
            }
        }
        let area = 0.5 * (q - p).perp(&(r - p)).abs();
        (area > 0.0).then_some((area * cosine) as f32)
    }
}

/// A vertex as a view sees it.
#[derive(Debug, Clone, Copy)]
struct Corner {
    in_cam: Point3<f64>,
    /// `None` behind the camera and outside of its cone of rays.
    pixel: Option<Point2<f64>>,
}

/// Depth of the nearest surface in every pixel.
struct DepthBuffer {
    width: usize,
    height: usize,
    /// Buffer pixels per image pixel.
    scale: f64,
    /// Of a pixel of the buffer.
    pixel_angle: f64,
    /// 0 where nothing is seen.
    depths: Vec<f32>,
}

impl DepthBuffer {
    fn draw(view: &View, mesh: &DrawableMesh) -> Self {
        let (w, h) = (f64::from(view.camera.width), f64::from(view.camera.height));
        let scale = (MAX_BUFFER_PIXELS / (w * h)).sqrt().min(1.0);
        let [width, height] = [w, h].map(|side| (side * scale).ceil() as u32);
        let eye = VirtualCamera::new(&view.camera.scaled(scale, width, height));
        Self {
            width: width as usize,
            height: height as usize,
            scale,
            pixel_angle: 1.0 / (scale * view.camera.focal().min()),
            depths: eye.draw_depth(mesh, &view.cam_from_world),
        }
    }

    fn at(&self, pixel: &Point2<f64>) -> f64 {
        let [x, y] = [(pixel.x, self.width), (pixel.y, self.height)]
            .map(|(at, size)| ((at * self.scale) as usize).min(size - 1));
        let depth = f64::from(self.depths[y * self.width + x]);
        if depth > 0.0 { depth } else { f64::INFINITY }
    }
}
