//! Small copies of photos, for people.

use png::{BitDepth, ColorType, Encoder, EncodingError};
use volery_scene::GrayImage;

use crate::{DecodedImage, downscale_to_max_side};

/// The upright photo as a PNG whose longer side is at most `max_side` pixels; never enlarged.
///
/// # Errors
///
/// [`EncodingError`] as the PNG encoder gives it.
pub fn write_thumbnail(image: &DecodedImage, max_side: u32) -> Result<Vec<u8>, EncodingError> {
    let (kind, planes) = match &image.color {
        Some(_) => (ColorType::Rgb, color_planes(image).to_vec()),
        None => (ColorType::Grayscale, vec![image.gray.clone()]),
    };
    let planes: Vec<GrayImage> = planes
        .into_iter()
        .map(|plane| downscale_to_max_side(&plane, max_side).unwrap_or(plane))
        .collect();
    let (width, height) = (planes[0].width(), planes[0].height());
    let samples: Vec<u8> = (0..planes[0].pixels().len())
        .flat_map(|i| planes.iter().map(move |plane| plane.pixels()[i]))
        .collect();
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, width, height);
    encoder.set_color(kind);
    encoder.set_depth(BitDepth::Eight);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&samples)?;
    writer.finish()?;
    Ok(bytes)
}

fn color_planes(image: &DecodedImage) -> [GrayImage; 3] {
    let (width, height) = (image.gray.width(), image.gray.height());
    let mut planes = [const { Vec::new() }; 3];
    for plane in &mut planes {
        plane.reserve_exact(width as usize * height as usize);
    }
    for y in 0..height {
        for x in 0..width {
            let rgb = image.rgb_at(x as f32, y as f32);
            for (plane, value) in planes.iter_mut().zip(rgb) {
                plane.push(value);
            }
        }
    }
    planes.map(|plane| GrayImage::new(width, height, plane).expect("as many as pixels"))
}

#[cfg(test)]
mod tests {
    use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

    use super::*;
    use crate::{DecodeLimits, decode_image};

    fn png(width: u32, height: u32, pixels: &[u8], color: ExtendedColorType) -> DecodedImage {
        let mut bytes = Vec::new();
        PngEncoder::new(&mut bytes).write_image(pixels, width, height, color).unwrap();
        decode_image(&bytes, &DecodeLimits::default()).unwrap()
    }

    fn thumbnail(image: &DecodedImage, max_side: u32) -> DecodedImage {
        let bytes = write_thumbnail(image, max_side).unwrap();
        decode_image(&bytes, &DecodeLimits::default()).unwrap()
    }

    /// Left half red, right half blue, at every size: planes are neither swapped nor shifted.
    #[test]
    fn colors_stay_where_they_are() {
        let pixel = |i: usize| if i % 80 < 40 { [250, 20, 10] } else { [10, 30, 240] };
        let pixels: Vec<u8> = (0..80 * 60).flat_map(pixel).collect();
        let photo = png(80, 60, &pixels, ExtendedColorType::Rgb8);
        for (max_side, size) in [(20, (20, 15)), (79, (79, 59)), (500, (80, 60))] {
            let small = thumbnail(&photo, max_side);
            assert_eq!((small.gray.width(), small.gray.height()), size);
            let (right, bottom) = (size.0 as f32 - 1.0, size.1 as f32 - 1.0);
            for y in [0.0, bottom] {
                assert_eq!(small.rgb_at(0.0, y), [250, 20, 10]);
                assert_eq!(small.rgb_at(right, y), [10, 30, 240]);
            }
        }
    }

    #[test]
    fn gray_stays_gray() {
        let photo = png(4, 2, &[0, 10, 100, 200, 20, 30, 100, 200], ExtendedColorType::L8);
        let small = thumbnail(&photo, 2);
        assert!(small.color.is_none());
        assert_eq!(small.gray.pixels(), [15, 150]);
    }
}
