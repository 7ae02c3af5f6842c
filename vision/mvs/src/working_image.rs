//! Images as the stereo sees them: undistorted, smaller, gray, in halving sizes.

use nalgebra::{Isometry3, Point2};
use volery_geometry::{Camera, CameraModel};
use volery_scene::{GrayImage, ImageId, Photo};

/// Sizes of an image, the largest included.
pub(crate) const NUM_LEVELS: usize = 3;

/// An undistorted image with its smaller copies.
#[derive(Debug, Clone)]
pub(crate) struct WorkingImage {
    pub(crate) id: ImageId,
    pub(crate) cam_from_world: Isometry3<f64>,
    /// Finest first; each half the size of the one before.
    pub(crate) levels: Vec<Level>,
    /// sRGB of the pixels of the finest level.
    colors: Option<Vec<[u8; 3]>>,
}

/// One size of an image.
#[derive(Debug, Clone)]
pub(crate) struct Level {
    /// Pinhole.
    pub(crate) camera: Camera,
    pub(crate) gray: GrayImage,
}

/// The pinhole camera of the images that [`WorkingImage::new`] makes: the same focal lengths and
/// principal point without the distortion, so that the size is at most `max_pixels`.
pub(crate) fn working_camera(camera: &Camera, max_pixels: u32) -> Camera {
    let num_pixels = f64::from(camera.width) * f64::from(camera.height);
    let scale = (f64::from(max_pixels) / num_pixels).sqrt().min(1.0);
    let size = |side: u32| ((f64::from(side) * scale) as u32).max(1);
    let (f, c) = (camera.focal() * scale, camera.principal_point() * scale);
    let (width, height) = (size(camera.width), size(camera.height));
    Camera::new(CameraModel::Pinhole, width, height, &[f.x, f.y, c.x, c.y])
        .expect("a checked camera stays one when scaled")
}

impl WorkingImage {
    /// Undistorts and scales `photo` of `camera` into the pixels of `working`.
    pub(crate) fn new(
        id: ImageId,
        photo: &Photo,
        camera: &Camera,
        working: &Camera,
        cam_from_world: Isometry3<f64>,
    ) -> Self {
        let gray = undistort(&photo.gray, camera, working);
        let colors = photo.colors.as_ref().map(|colors| {
            let seen = pixels_of(working).map(|pixel| seen_at(camera, working, &pixel));
            seen.map(|pixel| {
                let [x, y] = [(pixel.x, camera.width), (pixel.y, camera.height)]
                    .map(|(at, size)| (at.max(0.0) as usize).min(size as usize - 1));
                colors[y * camera.width as usize + x]
            })
            .collect()
        });
        Self { id, cam_from_world, levels: levels(gray, working), colors }
    }

    /// The gray values, then the colors if there are any.
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let mut bytes = self.levels[0].gray.pixels().to_vec();
        bytes.extend(self.colors.iter().flatten().flatten());
        bytes
    }

    /// The inverse of [`Self::to_bytes`]; `None` for another number of pixels.
    pub(crate) fn from_bytes(
        id: ImageId,
        bytes: &[u8],
        working: &Camera,
        cam_from_world: Isometry3<f64>,
    ) -> Option<Self> {
        let num_pixels = working.width as usize * working.height as usize;
        let (gray, colors) = bytes.split_at_checked(num_pixels)?;
        let gray = GrayImage::new(working.width, working.height, gray.to_vec())?;
        let colors = match colors.len() {
            0 => None,
            len if len == 3 * num_pixels => Some(colors.as_chunks::<3>().0.to_vec()),
            _ => return None,
        };
        Some(Self { id, cam_from_world, levels: levels(gray, working), colors })
    }

    /// sRGB of a pixel of the finest level.
    pub(crate) fn color(&self, index: usize) -> [u8; 3] {
        match &self.colors {
            Some(colors) => colors[index],
            None => [self.levels[0].gray.pixels()[index]; 3],
        }
    }
}

/// The image and its smaller copies.
fn levels(gray: GrayImage, working: &Camera) -> Vec<Level> {
    let mut levels = vec![Level { camera: *working, gray }];
    while levels.len() < NUM_LEVELS {
        let next = levels[levels.len() - 1].half();
        levels.push(next);
    }
    levels
}

impl Level {
    fn half(&self) -> Self {
        let gray = half_size(&self.gray);
        Self { camera: self.camera.scaled(0.5, gray.width(), gray.height()), gray }
    }
}

/// Mean of each two by two pixels.
fn half_size(image: &GrayImage) -> GrayImage {
    let (width, height) = ((image.width() / 2).max(1), (image.height() / 2).max(1));
    let last = |size: u32, at: u32| at.min(size - 1);
    let pixels = (0..height)
        .flat_map(|y| {
            let rows = [0, 1].map(|k| image.row(last(image.height(), 2 * y + k)));
            (0..width).map(move |x| {
                let [a, b] = [0, 1].map(|k| last(image.width(), 2 * x + k) as usize);
                let sum: u32 = rows.iter().map(|row| u32::from(row[a]) + u32::from(row[b])).sum();
                ((sum + 2) / 4) as u8
            })
        })
        .collect();
    GrayImage::new(width, height, pixels).expect("as many pixels as counted")
}

fn undistort(photo: &GrayImage, camera: &Camera, working: &Camera) -> GrayImage {
    let mut halved = photo.clone();
    let mut camera = *camera;
    while halved.width() >= 2 * working.width && halved.height() >= 2 * working.height {
        halved = half_size(&halved);
        camera = camera.scaled(0.5, halved.width(), halved.height());
    }
    let pixels = pixels_of(working)
        .map(|pixel| (bilinear(&halved, &seen_at(&camera, working, &pixel)) + 0.5) as u8)
        .collect();
    GrayImage::new(working.width, working.height, pixels).expect("as many pixels as counted")
}

/// Centers of the pixels of a camera, row by row.
fn pixels_of(camera: &Camera) -> impl Iterator<Item = Point2<f64>> + use<> {
    let Camera { width, height, .. } = *camera;
    let rows = (0..height).map(|y| f64::from(y) + 0.5);
    rows.flat_map(move |v| (0..width).map(move |x| Point2::new(f64::from(x) + 0.5, v)))
}

/// Where `camera` sees what `working` sees at `pixel`.
fn seen_at(camera: &Camera, working: &Camera, pixel: &Point2<f64>) -> Point2<f64> {
    let ray = working.unproject(pixel).expect("a pinhole has a ray for every pixel");
    camera.pixel_from_normalized(&ray)
}

/// Indices of the pixels of `working` that the photo of `camera` does not show: beyond its rim there is
/// only its rim.
pub(crate) fn beyond_the_photo(camera: &Camera, working: &Camera) -> impl Iterator<Item = usize> {
    let is_shown = |pixel| camera.contains(&seen_at(camera, working, &pixel));
    let indices = pixels_of(working).enumerate();
    indices.filter(move |(_, pixel)| !is_shown(*pixel)).map(|(index, _)| index)
}

fn bilinear(image: &GrayImage, pixel: &Point2<f64>) -> f64 {
    let axis = |value: f64, size: u32| {
        let at = (value - 0.5).clamp(0.0, f64::from(size - 1));
        let low = at as u32;
        (low, (low + 1).min(size - 1), at - f64::from(low))
    };
    let (x0, x1, fx) = axis(pixel.x, image.width());
    let (y0, y1, fy) = axis(pixel.y, image.height());
    let along = |y: u32| {
        let row = image.row(y);
        let [a, b] = [x0, x1].map(|x| f64::from(row[x as usize]));
        a + fx * (b - a)
    };
    let (top, bottom) = (along(y0), along(y1));
    top + fy * (bottom - top)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An image whose gray value is a smooth function of the ray, through any lens and scale.
    fn photo_of(camera: &Camera) -> Photo {
        let gray = pixels_of(camera)
            .map(|pixel| {
                let ray = camera.unproject(&pixel).unwrap();
                (128.0 + 60.0 * (5.0 * ray.x).sin() + 50.0 * (6.0 * ray.y).cos()).round() as u8
            })
            .collect();
        Photo { gray: GrayImage::new(camera.width, camera.height, gray).unwrap(), colors: None }
    }

    /// Dies if a half pixel is lost in scaling, halving or undistorting: the function changes by
    /// about three gray levels per pixel.
    #[test]
    fn every_lens_and_scale_shows_the_same_rays() {
        let lens = [200.0, 202.0, 161.0, 118.0, -0.2, 0.05, 0.001, -0.001];
        let lens = Camera::new(CameraModel::OpenCv, 320, 240, &lens).unwrap();
        let pinhole = Camera::from_focal(CameraModel::Pinhole, 320, 240, 200.0).unwrap();
        for camera in [pinhole, lens] {
            for max_pixels in [320 * 240, 200 * 150, 150 * 110] {
                let working = working_camera(&camera, max_pixels);
                assert!(working.width * working.height <= max_pixels);
                let photo = photo_of(&camera);
                let image =
                    WorkingImage::new(ImageId(0), &photo, &camera, &working, Isometry3::identity());
                for level in &image.levels {
                    let expected = photo_of(&level.camera).gray;
                    let (found, width) = (level.gray.pixels(), level.gray.width() as usize);
                    let inner = |index: &usize| {
                        let (x, y) = (index % width, index / width);
                        (3..width - 3).contains(&x)
                            && (3..level.gray.height() as usize - 3).contains(&y)
                    };
                    let differences = (0..found.len())
                        .filter(inner)
                        .map(|index| f64::from(found[index]) - f64::from(expected.pixels()[index]));
                    let (mut n, mut sum, mut worst) = (0.0, 0.0, 0.0_f64);
                    for difference in differences {
                        (n, sum, worst) = (n + 1.0, sum + difference, worst.max(difference.abs()));
                    }
                    assert!(worst <= 4.0 && (sum / n).abs() < 0.5, "{worst} {}", sum / n);
                }
            }
        }
    }
}
