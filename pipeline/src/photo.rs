//! A photo as the later stages see it: features and what its file says of the camera.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use volery_features::{GlobalDescriptor, detect_and_describe, global_descriptor};
use volery_formats::{
    DecodeError, DecodeLimits, DecodedImage, FocalSource, decode_image, downscale_to_max_side,
    read_exif, read_features, write_features,
};
use volery_scene::{Features, GrayImage, ImageSize};

use crate::{
    cache::{Key, KeyMaker},
    options::StageOptions,
};

/// What a file says of the camera that took it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct CameraHint {
    /// Upright.
    pub(crate) size: ImageSize,
    /// Maker, model and serial number.
    pub(crate) body: [Option<String>; 3],
    /// Focal length, pixels; `None` if EXIF says nothing of use.
    pub(crate) focal_px: Option<f64>,
    /// What in the EXIF made no sense.
    pub(crate) warnings: Vec<String>,
}

/// Features of a photo and what else is kept of it once the pixels are gone.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Photo {
    /// Its camera.
    pub(crate) hint: CameraHint,
    /// Standard deviation of the gray values, of 255.
    pub(crate) contrast: f32,
    /// Standard deviation of the Laplacian over that of the gray values: low when blurred.
    pub(crate) sharpness: f32,
    /// In pixels of the upright photo.
    pub(crate) features: Arc<Features>,
    /// sRGB at the keypoints.
    pub(crate) colors: Vec<[u8; 3]>,
    /// Of the whole image.
    pub(crate) global: GlobalDescriptor,
}

/// What of a [`Photo`] is written as JSON in the cache.
#[derive(Serialize, Deserialize)]
struct Header {
    hint: CameraHint,
    contrast: f32,
    sharpness: f32,
    num_features: usize,
    num_global: usize,
}

impl Photo {
    /// Decodes a file and takes its features.
    pub(crate) fn from_bytes(bytes: &[u8], options: &StageOptions) -> Result<Self, DecodeError> {
        let decoded = decode_image(bytes, &DecodeLimits::default())?;
        let hint = camera_hint(bytes, &decoded);
        let (width, height) = (decoded.gray.width(), decoded.gray.height());
        let smaller = downscale_to_max_side(&decoded.gray, options.max_image_size);
        let gray = smaller.as_ref().unwrap_or(&decoded.gray);
        let (contrast, sharpness) = contrast_and_sharpness(gray);
        let mut features = detect_and_describe(gray, &options.sift);
        let global = global_descriptor(&features);
        let scale_x = width as f32 / gray.width() as f32;
        let scale_y = height as f32 / gray.height() as f32;
        if smaller.is_some() {
            for keypoint in &mut features.keypoints {
                keypoint.x *= scale_x;
                keypoint.y *= scale_y;
                keypoint.scale *= scale_x;
            }
        }
        let colors = features.keypoints.iter().map(|k| decoded.rgb_at(k.x, k.y)).collect();
        Ok(Self { hint, contrast, sharpness, features: Arc::new(features), colors, global })
    }

    /// Key of [`Self::from_bytes`] for a file with hash `file`.
    pub(crate) fn key(file: &blake3::Hash, options: &StageOptions) -> Key {
        KeyMaker::new("features")
            .with(file.as_bytes())
            .with_debug(&options.sift)
            .with_debug(&options.max_image_size)
            .key()
    }

    /// For the cache.
    pub(crate) fn to_bytes(&self) -> Result<Vec<u8>, serde_json::Error> {
        let header = serde_json::to_vec(&Header {
            hint: self.hint.clone(),
            contrast: self.contrast,
            sharpness: self.sharpness,
            num_features: self.features.len(),
            num_global: self.global.0.len(),
        })?;
        let mut bytes = (header.len() as u64).to_le_bytes().to_vec();
        bytes.extend(header);
        bytes.extend(self.global.0.iter().flat_map(|v| v.to_le_bytes()));
        bytes.extend(self.colors.iter().flatten());
        bytes.extend(write_features(&self.features));
        Ok(bytes)
    }

    /// From the cache; `None` if the bytes are of another kind.
    pub(crate) fn from_cache(bytes: &[u8]) -> Option<Self> {
        let (len, rest) = bytes.split_first_chunk::<8>()?;
        let (header, rest) = rest.split_at_checked(u64::from_le_bytes(*len) as usize)?;
        let header: Header = serde_json::from_slice(header).ok()?;
        let (global, rest) = rest.split_at_checked(header.num_global.checked_mul(4)?)?;
        let (colors, features) = rest.split_at_checked(header.num_features.checked_mul(3)?)?;
        let features = read_features(features).ok()?;
        let global = global.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        (features.len() == header.num_features).then(|| Self {
            hint: header.hint,
            contrast: header.contrast,
            sharpness: header.sharpness,
            features: Arc::new(features),
            colors: colors.as_chunks::<3>().0.to_vec(),
            global: GlobalDescriptor(global),
        })
    }

    /// Whether it shows something, but without any sharp edge.
    pub(crate) fn is_blurred(&self) -> bool {
        self.contrast > MIN_CONTRAST && self.sharpness < MIN_SHARPNESS
    }
}

/// Gray levels; below, the photo shows nothing.
const MIN_CONTRAST: f32 = 8.0;

/// A photo with a Gaussian blur of 4 pixels lies near 0.05, a sharp one above 0.2.
const MIN_SHARPNESS: f32 = 0.06;

fn camera_hint(bytes: &[u8], decoded: &DecodedImage) -> CameraHint {
    let exif = read_exif(bytes);
    let size = ImageSize { width: decoded.gray.width(), height: decoded.gray.height() };
    let focal = exif.focal_px(size.width, size.height);
    let mut warnings = exif.warnings;
    warnings.extend(focal.warnings);
    CameraHint {
        size,
        body: [exif.make, exif.model, exif.serial],
        focal_px: (focal.source != FocalSource::Guess).then_some(focal.px),
        warnings,
    }
}

fn contrast_and_sharpness(image: &GrayImage) -> (f32, f32) {
    let pixels = image.pixels();
    let n = pixels.len().max(1) as f64;
    let (mut sum, mut sum2) = (0_u64, 0_u64);
    for &p in pixels {
        sum += u64::from(p);
        sum2 += u64::from(p) * u64::from(p);
    }
    let mean = sum as f64 / n;
    let deviation = (sum2 as f64 / n - mean * mean).max(0.0).sqrt();
    let mut laplacian2 = 0_i64;
    for y in 1..image.height().saturating_sub(1) {
        let [up, row, down] = [image.row(y - 1), image.row(y), image.row(y + 1)];
        for x in 1..row.len().saturating_sub(1) {
            let [c, l, r, u, d] = [row[x], row[x - 1], row[x + 1], up[x], down[x]].map(i64::from);
            let value = 4 * c - l - r - u - d;
            laplacian2 += value * value;
        }
    }
    let laplacian = (laplacian2 as f64 / n).sqrt();
    (deviation as f32, if deviation > 0.0 { (laplacian / deviation) as f32 } else { 0.0 })
}
