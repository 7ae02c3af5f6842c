//! Drawn images and their depth as PNG.

use png::{BitDepth, ColorType, Encoder, EncodingError};

/// Deepest value of a 16-bit image, millimeters.
const MAX_MM: f32 = 65_535.0;

/// sRGB, row by row, one color per pixel.
///
/// # Errors
///
/// [`EncodingError`] as the PNG encoder gives it.
pub fn write_png(width: u32, height: u32, colors: &[[u8; 3]]) -> Result<Vec<u8>, EncodingError> {
    encode(width, height, ColorType::Rgb, BitDepth::Eight, colors.as_flattened())
}

/// 16-bit gray: millimeters, rounded; 0 where nothing is seen or beyond 65.535 m.
///
/// # Errors
///
/// [`EncodingError`] as the PNG encoder gives it.
pub fn write_depth_png(width: u32, height: u32, depth_m: &[f32]) -> Result<Vec<u8>, EncodingError> {
    let millimeters = |depth: &f32| {
        let mm = (depth * 1000.0).round();
        // NaN is no depth either.
        if (0.0..=MAX_MM).contains(&mm) { mm as u16 } else { 0 }
    };
    let samples: Vec<u8> =
        depth_m.iter().flat_map(|depth| millimeters(depth).to_be_bytes()).collect();
    encode(width, height, ColorType::Grayscale, BitDepth::Sixteen, &samples)
}

fn encode(
    width: u32,
    height: u32,
    kind: ColorType,
    bits: BitDepth,
    samples: &[u8],
) -> Result<Vec<u8>, EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, width, height);
    encoder.set_color(kind);
    encoder.set_depth(bits);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(samples)?;
    writer.finish()?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(bytes: &[u8]) -> (png::OutputInfo, Vec<u8>) {
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut samples = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut samples).unwrap();
        (info, samples)
    }

    #[test]
    fn colors_come_back() {
        let colors = [[1, 2, 3], [255, 0, 7], [9, 9, 9], [4, 5, 6], [0, 0, 0], [8, 8, 1]];
        let (info, samples) = decoded(&write_png(3, 2, &colors).unwrap());
        assert_eq!((info.width, info.height), (3, 2));
        assert_eq!(samples, colors.as_flattened());
        assert!(write_png(3, 3, &colors).is_err());
    }

    #[test]
    fn depth_is_in_millimeters_and_nothing_is_zero() {
        let depth = [0.0, 1.2344, 65.535, 65.6, f32::NAN, -1.0];
        let (info, samples) = decoded(&write_depth_png(6, 1, &depth).unwrap());
        assert_eq!(info.bit_depth, BitDepth::Sixteen);
        let values: Vec<u16> =
            samples.chunks(2).map(|b| u16::from_be_bytes([b[0], b[1]])).collect();
        assert_eq!(values, [0, 1234, 65_535, 0, 0, 0]);
    }
}
