//! What an image sees of a mesh.

use nalgebra::{Isometry3, Point2, Point3};
use volery_geometry::Camera;
use volery_scene::{ImageId, RegisteredImage, TriangleMesh};

/// Pixels of the depth buffer; larger images are judged at this size.
const MAX_BUFFER_PIXELS: f64 = 400_000.0;
/// A triangle that is longer in the image is drawn in parts, pixels of the buffer.
const MAX_DRAWN_SIDE: f64 = 24.0;
/// A triangle across the border of the cone of rays is not drawn if it is shorter, pixels of the
/// buffer: the cone is wider than the image.
const MAX_LOST_SIDE: f64 = 8.0;
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
    pub(super) fn seen_triangles(&self, mesh: &TriangleMesh) -> Vec<(u32, f32)> {
        let corners: Vec<Corner> = mesh.vertices.iter().map(|v| self.corner(v)).collect();
        let depths = DepthBuffer::draw(self, mesh, &corners);
        let seen = |(index, triangle): (usize, &[u32; 3])| {
            let corners = triangle.map(|v| corners[v as usize]);
            Some((index as u32, self.quality(&depths, &corners)?))
        };
        mesh.triangles.iter().enumerate().filter_map(seen).collect()
    }

    fn corner(&self, point: &Point3<f64>) -> Corner {
        self.corner_in_cam(self.cam_from_world * point)
    }

    fn corner_in_cam(&self, in_cam: Point3<f64>) -> Corner {
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
    depths: Vec<f32>,
}

impl DepthBuffer {
    fn draw(view: &View, mesh: &TriangleMesh, corners: &[Corner]) -> Self {
        let (w, h) = (f64::from(view.camera.width), f64::from(view.camera.height));
        let scale = (MAX_BUFFER_PIXELS / (w * h)).sqrt().min(1.0);
        let [width, height] = [w, h].map(|side| (side * scale).ceil() as usize);
        let pixel_angle = 1.0 / (scale * view.camera.focal().min());
        let depths = vec![f32::INFINITY; width * height];
        let mut buffer = Self { width, height, scale, pixel_angle, depths };
        for triangle in &mesh.triangles {
            buffer.draw_triangle(view, triangle.map(|v| corners[v as usize]));
        }
        buffer
    }

    fn at(&self, pixel: &Point2<f64>) -> f64 {
        let [x, y] = [(pixel.x, self.width), (pixel.y, self.height)]
            .map(|(at, size)| ((at * self.scale) as usize).min(size - 1));
        f64::from(self.depths[y * self.width + x])
    }

    /// Draws a triangle in parts that are small enough for straight edges and even depth.
    fn draw_triangle(&mut self, view: &View, corners: [Corner; 3]) {
        if corners.iter().all(|corner| corner.in_cam.z < NEAR) {
            return;
        }
        if let [Some(a), Some(b), Some(c)] = corners.map(|corner| corner.pixel) {
            let [a, b, c] = [a, b, c].map(|pixel| pixel * self.scale);
            let (low, high) = (a.inf(&b).inf(&c), a.sup(&b).sup(&c));
            let outside = high.x < 0.0
                || high.y < 0.0
                || low.x > self.width as f64
                || low.y > self.height as f64;
            if outside {
                return;
            }
            if (high - low).max() <= MAX_DRAWN_SIDE {
                let [za, zb, zc] = corners.map(|corner| corner.in_cam.z);
                self.fill([(a, za), (b, zb), (c, zc)], low, high);
                return;
            }
        } else if self.is_negligible(view, &corners) {
            return;
        }
        let [a, b, c] = corners;
        let [ab, bc, ca] = [(a, b), (b, c), (c, a)]
            .map(|(p, q)| view.corner_in_cam(nalgebra::center(&p.in_cam, &q.in_cam)));
        for part in [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]] {
            self.draw_triangle(view, part);
        }
    }

    /// Whether a triangle that is not wholly within the cone of rays is not within it at all, or so
    /// small that its parts beyond the border of the image are all that could be lost.
    fn is_negligible(&self, view: &View, corners: &[Corner; 3]) -> bool {
        let points = corners.map(|corner| corner.in_cam);
        let m = view.max_slope;
        let is_beside = |beyond: fn(&Point3<f64>, f64) -> bool| points.iter().all(|p| beyond(p, m));
        let [a, b, c] = points;
        let longest =
            (b - a).norm_squared().max((c - b).norm_squared()).max((a - c).norm_squared());
        let depth = a.z.max(b.z).max(c.z);
        longest.sqrt() < MAX_LOST_SIDE * self.pixel_angle * depth
            || is_beside(|p, m| p.x > m * p.z)
            || is_beside(|p, m| p.x < -m * p.z)
            || is_beside(|p, m| p.y > m * p.z)
            || is_beside(|p, m| p.y < -m * p.z)
    }

    fn fill(&mut self, corners: [(Point2<f64>, f64); 3], low: Point2<f64>, high: Point2<f64>) {
        let [(a, za), (b, zb), (c, zc)] = corners;
        let area = (b - a).perp(&(c - a));
        if area == 0.0 {
            return;
        }
        // Depth is even over pixels that are small against it.
        let first = low.map(|v| (v - 0.5).ceil().max(0.0) as usize);
        let end = |v: f64, size: usize| ((v - 0.5).floor() + 1.0).clamp(0.0, size as f64) as usize;
        for y in first.y..end(high.y, self.height) {
            for x in first.x..end(high.x, self.width) {
                let p = Point2::new(x as f64 + 0.5, y as f64 + 0.5);
                let wa = (b - p).perp(&(c - p)) / area;
                let wb = (c - p).perp(&(a - p)) / area;
                let wc = 1.0 - wa - wb;
                if wa >= 0.0 && wb >= 0.0 && wc >= 0.0 {
                    let depth = (wa * za + wb * zb + wc * zc) as f32;
                    let nearest = &mut self.depths[y * self.width + x];
                    *nearest = nearest.min(depth);
                }
            }
        }
    }
}
