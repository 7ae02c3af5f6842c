//! Pictures as JPEG.
//!
//! Baseline, 4:2:0, with the tables that the standard gives as typical. Source: ITU-T T.81 (section
//! and table numbers below); JFIF: ITU-T T.871.

mod bits;
mod tables;
mod transform;

use volery_scene::Texture;

use bits::BitWriter;
use tables::{CHROMA_QUANTIZATION, Huffman, LUMA_QUANTIZATION, TABLES, ZIGZAG, quantization};
use transform::forward_dct;

/// Why there is no JPEG.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum WriteJpegError {
    /// A side of nothing, or of more than the format can say.
    #[error("a JPEG cannot be {width} by {height} pixels")]
    Size {
        /// Pixels.
        width: u32,
        /// Pixels.
        height: u32,
    },
    /// Pixels that are not as many as the size says.
    #[error("{got} pixels instead of {expected}")]
    PixelCount {
        /// What came.
        got: usize,
        /// Width times height.
        expected: usize,
    },
}

/// A picture as JPEG of a quality from 1 to 100, on libjpeg's scale.
///
/// # Errors
///
/// [`WriteJpegError`] for sizes that JPEG does not have and for missing pixels.
pub fn write_jpeg(picture: &Texture, quality: u8) -> Result<Vec<u8>, WriteJpegError> {
    let (width, height) = (picture.width, picture.height);
    let [Ok(w), Ok(h)] = [width, height].map(u16::try_from) else {
        return Err(WriteJpegError::Size { width, height });
    };
    if w == 0 || h == 0 {
        return Err(WriteJpegError::Size { width, height });
    }
    let expected = w as usize * h as usize;
    if picture.pixels.len() != expected {
        return Err(WriteJpegError::PixelCount { got: picture.pixels.len(), expected });
    }
    let quantizations =
        [LUMA_QUANTIZATION, CHROMA_QUANTIZATION].map(|table| quantization(&table, quality));
    let mut bytes = header(w, h, &quantizations);
    Scan::new(picture, &quantizations).write(&mut bytes);
    bytes.extend([0xff, 0xd9]);
    Ok(bytes)
}

/// Everything before the coefficients (B.2).
fn header(width: u16, height: u16, quantizations: &[[u8; 64]; 2]) -> Vec<u8> {
    let mut bytes = vec![0xff, 0xd8];
    let mut segment = |marker: u8, content: &[u8]| {
        bytes.extend([0xff, marker]);
        bytes.extend((content.len() as u16 + 2).to_be_bytes());
        bytes.extend(content);
    };
    segment(0xe0, b"JFIF\0\x01\x02\0\0\x01\0\x01\0\0");
    for (id, table) in quantizations.iter().enumerate() {
        let mut content = vec![id as u8];
        content.extend(ZIGZAG.iter().map(|&place| table[place as usize]));
        segment(0xdb, &content);
    }
    let mut frame = vec![8];
    frame.extend(height.to_be_bytes());
    frame.extend(width.to_be_bytes());
    // Component, its sampling, its quantization.
    frame.extend([3, 1, 0x22, 0, 2, 0x11, 1, 3, 0x11, 1]);
    segment(0xc0, &frame);
    for (id, table) in [0x00, 0x10, 0x01, 0x11].into_iter().zip(&TABLES) {
        let mut content = vec![id];
        content.extend(table.counts);
        content.extend(table.values);
        segment(0xc4, &content);
    }
    segment(0xda, &[3, 1, 0x00, 2, 0x11, 3, 0x11, 0, 63, 0]);
    bytes
}

/// The coefficients of all blocks.
struct Scan<'a> {
    picture: &'a Texture,
    /// 1 over the steps, luma and chroma.
    inverse_steps: [[f32; 64]; 2],
    /// DC and AC of luma, then of chroma.
    huffman: [Huffman; 4],
    /// DC of the blocks before.
    last_dc: [i32; 3],
}

impl<'a> Scan<'a> {
    fn new(picture: &'a Texture, quantizations: &[[u8; 64]; 2]) -> Self {
        Self {
            picture,
            inverse_steps: quantizations.map(|table| table.map(|step| 1.0 / f32::from(step))),
            huffman: TABLES.map(|table| Huffman::new(&table)),
            last_dc: [0; 3],
        }
    }

    fn write(mut self, bytes: &mut Vec<u8>) {
        let mut writer = BitWriter::new(bytes);
        for top in (0..self.picture.height).step_by(16) {
            for left in (0..self.picture.width).step_by(16) {
                let [luma, blue, red] = self.unit(left, top);
                for corner in [0, 8, 128, 136] {
                    let block = |i: usize| luma[corner + i / 8 * 16 + i % 8];
                    self.write_block(&mut writer, 0, std::array::from_fn(block));
                }
                for (component, plane) in [(1, blue), (2, red)] {
                    let block = |i: usize| {
                        let at = i / 8 * 32 + i % 8 * 2;
                        (plane[at] + plane[at + 1] + plane[at + 16] + plane[at + 17]) / 4.0
                    };
                    self.write_block(&mut writer, component, std::array::from_fn(block));
                }
            }
        }
        writer.finish();
    }

    /// Y, Cb and Cr of 16 x 16 pixels about 0 (T.871, section 7); beyond the picture its border goes
    /// on.
    fn unit(&self, left: u32, top: u32) -> [[f32; 256]; 3] {
        let color: [[f32; 3]; 256] = std::array::from_fn(|i| {
            let x = (left + i as u32 % 16).min(self.picture.width - 1);
            let y = (top + i as u32 / 16).min(self.picture.height - 1);
            let index = y as usize * self.picture.width as usize + x as usize;
            self.picture.pixels[index].map(f32::from)
        });
        [
            color.map(|[r, g, b]| 0.299 * r + 0.587 * g + 0.114 * b - 128.0),
            color.map(|[r, g, b]| -0.168_736 * r - 0.331_264 * g + 0.5 * b),
            color.map(|[r, g, b]| 0.5 * r - 0.418_688 * g - 0.081_312 * b),
        ]
    }

    /// F.1.2: the difference of the first coefficient, then runs of zeros and what follows them.
    fn write_block(&mut self, writer: &mut BitWriter, component: usize, mut block: [f32; 64]) {
        let kind = component.min(1);
        forward_dct(&mut block);
        let steps = &self.inverse_steps[kind];
        let coefficient =
            |k: usize| (block[ZIGZAG[k] as usize] * steps[ZIGZAG[k] as usize]).round() as i32;
        let [dc_codes, ac_codes] = [&self.huffman[2 * kind], &self.huffman[2 * kind + 1]];
        let dc = coefficient(0);
        let difference = dc - self.last_dc[component];
        self.last_dc[component] = dc;
        writer.put_coded(dc_codes, 0, difference);
        let mut num_zeros = 0;
        for k in 1..64 {
            let value = coefficient(k);
            if value == 0 {
                num_zeros += 1;
                continue;
            }
            while num_zeros > 15 {
                writer.put_symbol(ac_codes, 0xf0);
                num_zeros -= 16;
            }
            writer.put_coded(ac_codes, num_zeros << 4, value);
            num_zeros = 0;
        }
        if num_zeros > 0 {
            writer.put_symbol(ac_codes, 0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DecodeLimits, decode_image};

    fn picture(width: u32, height: u32) -> Texture {
        let color = |i: u32| {
            let (x, y) = ((i % width) as f32, (i / width) as f32);
            let wave = |v: f32| (127.0 + 90.0 * v.sin()) as u8;
            [wave(x / 9.0), wave(y / 7.0 + 1.0), wave((x + y) / 11.0 + 2.0)]
        };
        Texture { width, height, pixels: (0..width * height).map(color).collect() }
    }

    /// Root mean square over all channels.
    fn error(picture: &Texture, quality: u8) -> f64 {
        let bytes = write_jpeg(picture, quality).unwrap();
        let decoded = decode_image(&bytes, &DecodeLimits::default()).unwrap();
        let color = decoded.color.unwrap();
        assert_eq!((color.width(), color.height()), (picture.width, picture.height));
        let rgb = color.to_rgb();
        let squares = rgb.iter().zip(picture.pixels.as_flattened());
        let sum: f64 = squares.map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum();
        (sum / rgb.len() as f64).sqrt()
    }

    /// Read by a decoder that is not ours; sizes need not be multiples of the blocks.
    #[test]
    fn what_is_read_is_what_was_written() {
        for (width, height) in [(64, 48), (61, 35), (1, 1), (17, 16)] {
            let picture = picture(width, height);
            let [fine, coarse] = [95, 30].map(|quality| error(&picture, quality));
            assert!(fine < 3.0, "{fine} at {width} x {height}");
            assert!(fine <= coarse && coarse < 12.0, "{coarse} at {width} x {height}");
        }
    }

    /// The hardest to code: every coefficient of every block is there.
    #[test]
    fn noise_is_survived() {
        let mut random = volery_geometry::Rng::new(1);
        let mut picture = picture(80, 80);
        for pixel in &mut picture.pixels {
            *pixel = [if random.uniform() < 0.5 { 0 } else { 255 }; 3];
        }
        let rms = error(&picture, 100);
        assert!(rms < 2.5, "{rms}");
    }

    #[test]
    fn lower_quality_is_smaller() {
        let picture = picture(128, 128);
        let sizes = [10, 50, 75, 95].map(|quality| write_jpeg(&picture, quality).unwrap().len());
        assert!(sizes.is_sorted() && sizes[0] < sizes[3], "{sizes:?}");
    }

    #[test]
    fn sizes_that_cannot_be_are_named() {
        let size = |width, height| write_jpeg(&Texture { width, height, pixels: Vec::new() }, 90);
        assert_eq!(size(0, 4), Err(WriteJpegError::Size { width: 0, height: 4 }));
        assert_eq!(size(70_000, 4), Err(WriteJpegError::Size { width: 70_000, height: 4 }));
        assert_eq!(size(3, 4), Err(WriteJpegError::PixelCount { got: 0, expected: 12 }));
    }
}
