//! Bytes of a query to pixels and a camera.

use volery_api::ImageEncoding;
use volery_formats::{
    DecodeError, DecodeLimits, FocalSource, decode_image, downscale_to_max_side, read_exif,
};
use volery_geometry::Camera;
use volery_scene::GrayImage;

use crate::{
    cameras::{likely_camera, scaled_to},
    map_folder::MapFolder,
};

/// Queries are made smaller until no side is longer, pixels: more costs time and adds nothing.
const MAX_QUERY_SIZE: u32 = 1600;

/// An image to be localized.
pub struct Query {
    /// Pixels, upright.
    pub image: GrayImage,
    /// Intrinsics for these pixels.
    pub camera: Camera,
}

/// Why an image cannot be asked about.
#[derive(Debug, thiserror::Error)]
pub enum QueryError {
    /// It cannot be decoded.
    #[error(transparent)]
    Decode(#[from] DecodeError),
    /// Raw pixels without size, or of another size than their number.
    #[error("raw pixels need width and height that fit their number")]
    RawSize,
    /// The camera given is for an image of other proportions.
    #[error(
        "the camera is for {camera_width} x {camera_height} pixels, the image has {width} x {height}"
    )]
    OtherSize {
        /// Pixels.
        camera_width: u32,
        /// Pixels.
        camera_height: u32,
        /// Pixels.
        width: u32,
        /// Pixels.
        height: u32,
    },
    /// No camera given, none in the map that fits, no EXIF.
    #[error("nothing is known of the camera of this image")]
    UnknownCamera,
}

impl QueryError {
    /// The stable code.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Decode(error) => error.code(),
            Self::RawSize => "bad_request",
            Self::OtherSize { .. } => "camera_size_mismatch",
            Self::UnknownCamera => "unknown_camera",
        }
    }
}

/// Decodes a query and finds its camera: the one given, else the map's own camera of this shape
/// (unless EXIF speaks of another lens), else EXIF.
pub fn query_image(
    bytes: &[u8],
    encoding: ImageEncoding,
    raw_size: Option<(u32, u32)>,
    camera: Option<&Camera>,
    map: &MapFolder,
) -> Result<Query, QueryError> {
    let image = match encoding {
        ImageEncoding::Gray8 | ImageEncoding::Rgb8 => raw_image(bytes, encoding, raw_size)?,
        _ => decode_image(bytes, &DecodeLimits::default())?.gray,
    };
    let (width, height) = (image.width(), image.height());
    let camera = match camera {
        Some(camera) => scaled_to(camera, width, height).ok_or(QueryError::OtherSize {
            camera_width: camera.width,
            camera_height: camera.height,
            width,
            height,
        })?,
        None => own_camera(bytes, width, height, map).ok_or(QueryError::UnknownCamera)?,
    };
    Ok(match downscale_to_max_side(&image, MAX_QUERY_SIZE) {
        Some(smaller) => {
            let scale = f64::from(smaller.width()) / f64::from(width);
            let camera = camera.scaled(scale, smaller.width(), smaller.height());
            Query { image: smaller, camera }
        }
        None => Query { image, camera },
    })
}

fn own_camera(bytes: &[u8], width: u32, height: u32, map: &MapFolder) -> Option<Camera> {
    let exif = read_exif(bytes).focal_px(width, height);
    let exif_px = (exif.source != FocalSource::Guess).then_some(exif.px);
    likely_camera(map.camera_for(width, height), (width, height), exif_px)
}

fn raw_image(
    bytes: &[u8],
    encoding: ImageEncoding,
    size: Option<(u32, u32)>,
) -> Result<GrayImage, QueryError> {
    let (width, height) = size.ok_or(QueryError::RawSize)?;
    let limits = DecodeLimits::default();
    if width.max(height) > limits.max_side || width.min(height) == 0 {
        return Err(QueryError::RawSize);
    }
    let pixels = match encoding {
        // Rec. 601 luma in 16-bit fractions, as the decoders make it.
        ImageEncoding::Rgb8 => {
            let (pixels, rest) = bytes.as_chunks::<3>();
            if !rest.is_empty() {
                return Err(QueryError::RawSize);
            }
            let luma = |p: &[u8; 3]| {
                let [r, g, b] = p.map(u32::from);
                ((19_595 * r + 38_470 * g + 7_471 * b + 32_768) >> 16) as u8
            };
            pixels.iter().map(luma).collect()
        }
        _ => bytes.to_vec(),
    };
    GrayImage::new(width, height, pixels).ok_or(QueryError::RawSize)
}
