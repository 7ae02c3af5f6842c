//! The photo as it is compared: small, without distortion, in several sizes.

use nalgebra::{Point2, Vector2};
use volery_geometry::{Camera, CameraModel};
use volery_scene::GrayImage;

use super::planes::{halved, normalized, sample, shrunk};

/// Longest side of the largest level, pixels.
const MAX_SIDE: u32 = 320;
/// Levels, each half of the one before.
pub(crate) const NUM_LEVELS: usize = 3;
/// Steps of the focal length in search of one that shows no rim.
const ZOOM: f64 = 1.02;
const MAX_ZOOMS: usize = 60;

/// A size of the photo.
#[derive(Debug, Clone)]
pub(crate) struct Level {
    /// A pinhole.
    pub(crate) camera: Camera,
    pub(crate) gray: GrayImage,
    /// With local contrast.
    pub(crate) normalized: GrayImage,
}

/// The photo through a pinhole at a point of view of its own, finest level first (P66).
#[derive(Debug, Clone)]
pub(crate) struct Working {
    pub(crate) levels: Vec<Level>,
}

impl Working {
    /// `None` if the photo is not the camera's, too small, or its lens shows no part of it.
    pub(crate) fn new(photo: &GrayImage, camera: &Camera) -> Option<Self> {
        if (photo.width(), photo.height()) != (camera.width, camera.height) {
            return None;
        }
        let pinhole = pinhole_for(camera)?;
        let longer = |camera: &Camera| camera.width.max(camera.height);
        let factor = (longer(camera) / longer(&pinhole)).max(1);
        let small = shrunk(photo, factor);
        let is_small_photo = is_pinhole(camera) && longer(camera) == factor * longer(&pinhole);
        let mut gray =
            if is_small_photo { small } else { warped(&small, factor, camera, &pinhole)? };
        let mut camera = pinhole;
        let mut levels = Vec::with_capacity(NUM_LEVELS);
        for _ in 0..NUM_LEVELS {
            let normalized = normalized(&gray, radius_at(&camera), |_| true);
            let next = halved(&gray);
            levels.push(Level { camera, gray, normalized });
            camera = camera.scaled(0.5, next.width(), next.height());
            gray = next;
        }
        Some(Self { levels })
    }
}

/// What a pinhole sees of a photo that was made smaller by `factor`.
fn warped(small: &GrayImage, factor: u32, camera: &Camera, pinhole: &Camera) -> Option<GrayImage> {
    let mut pixels = Vec::with_capacity(pinhole.width as usize * pinhole.height as usize);
    for y in 0..pinhole.height {
        for x in 0..pinhole.width {
            let center = Point2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let at = camera.pixel_from_normalized(&pinhole.unproject(&center)?);
            let clamp = |v: f64, size: u32| {
                (v / f64::from(factor)).clamp(0.5, f64::from(size) - 0.501) as f32
            };
            let [value, ..] =
                sample(small, clamp(at.x, small.width()), clamp(at.y, small.height()))?;
            pixels.push((value + 0.5) as u8);
        }
    }
    GrayImage::new(pinhole.width, pinhole.height, pixels)
}

fn is_pinhole(camera: &Camera) -> bool {
    matches!(camera.model, CameraModel::SimplePinhole | CameraModel::Pinhole)
}

/// How far the surroundings of a pixel reach, pixels.
pub(crate) fn radius_at(camera: &Camera) -> usize {
    (camera.width as usize / 12).max(3)
}

/// A pinhole that sees no more than the camera.
fn pinhole_for(camera: &Camera) -> Option<Camera> {
    let scale = (f64::from(MAX_SIDE) / f64::from(camera.width.max(camera.height))).min(1.0);
    let size = |v: u32| (f64::from(v) * scale).floor() as u32;
    let (width, height) = (size(camera.width), size(camera.height));
    if width.min(height) < 64 {
        return None;
    }
    let center = camera.principal_point() * scale;
    let mut focal = camera.focal() * scale;
    for _ in 0..MAX_ZOOMS {
        let params = [focal.x, focal.y, center.x, center.y];
        let pinhole = Camera::new(CameraModel::Pinhole, width, height, &params).ok()?;
        if is_pinhole(camera) || sees_no_rim(&pinhole, camera) {
            return Some(pinhole);
        }
        focal *= ZOOM;
    }
    None
}

fn sees_no_rim(pinhole: &Camera, camera: &Camera) -> bool {
    let [w, h] = [pinhole.width, pinhole.height].map(f64::from);
    let focal_pixel = |p: Point2<f64>| {
        let xy: Vector2<f64> = pinhole.unproject(&p)?;
        let pixel = camera.pixel_from_normalized(&xy);
        // Beyond the fold of a lens model a pixel belongs to another ray.
        let back = camera.unproject(&pixel)?;
        (camera.contains(&pixel) && (back - xy).norm() < 1e-6).then_some(())
    };
    (0..=16).all(|k| {
        let s = f64::from(k) / 16.0;
        [(s * w, 0.0), (s * w, h), (0.0, s * h), (w, s * h)]
            .into_iter()
            .all(|(x, y)| focal_pixel(Point2::new(x, y)).is_some())
    })
}
