//! The frame header of a JPEG (ITU-T T.81, B.2.2).

use super::DecodeError;
use super::segments::damaged;

/// Size and channels.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Frame {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) components: Vec<Component>,
    /// Coefficients of the whole image are kept until its last scan.
    pub(super) progressive: bool,
}

/// A channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Component {
    pub(super) id: u8,
    /// Samples, relative to the other channels.
    horizontal: u8,
    vertical: u8,
}

impl Component {
    /// Blocks of 8 x 8 samples in an MCU of all channels.
    pub(super) fn num_blocks_per_mcu(&self) -> usize {
        usize::from(self.horizontal) * usize::from(self.vertical)
    }
}

impl Frame {
    /// MCUs of a scan of several channels (A.2.3).
    pub(super) fn num_mcus(&self) -> usize {
        let (horizontal, vertical) = self.max_sampling();
        let across = self.width.div_ceil(8 * horizontal);
        let down = self.height.div_ceil(8 * vertical);
        across as usize * down as usize
    }

    /// Blocks of a scan of the channel `index` alone (A.2.2).
    pub(super) fn num_blocks_alone(&self, index: usize) -> usize {
        let (horizontal, vertical) = self.max_sampling();
        let component = self.components[index];
        let across = (self.width * u32::from(component.horizontal)).div_ceil(horizontal);
        let down = (self.height * u32::from(component.vertical)).div_ceil(vertical);
        across.div_ceil(8) as usize * down.div_ceil(8) as usize
    }

    fn max_sampling(&self) -> (u32, u32) {
        let horizontal = self.components.iter().map(|c| c.horizontal).max().unwrap_or(1);
        let vertical = self.components.iter().map(|c| c.vertical).max().unwrap_or(1);
        (horizontal.into(), vertical.into())
    }
}

/// Reads a frame header; refuses what is not decoded: lossless, arithmetic coding, 12 bits.
pub(super) fn read_frame(code: u8, body: &[u8]) -> Result<Frame, DecodeError> {
    // Precision, height, width, number of components.
    let [precision, h1, h0, w1, w0, num_components, ref list @ ..] = *body else {
        return Err(damaged("JPEG frame header is too short"));
    };
    let (width, height) = (u16::from_be_bytes([w1, w0]), u16::from_be_bytes([h1, h0]));
    if !(0xc0..=0xc2).contains(&code) {
        let detail = format!("JPEG coding process {}", code - 0xc0);
        return Err(DecodeError::Unsupported { detail });
    }
    if precision != 8 {
        return Err(DecodeError::Unsupported { detail: format!("JPEG of {precision} bits") });
    }
    if !matches!(num_components, 1 | 3) {
        let detail = format!("JPEG of {num_components} channels");
        return Err(DecodeError::Unsupported { detail });
    }
    if width == 0 || height == 0 {
        return Err(damaged(&format!("size {width} x {height}")));
    }
    let components: Vec<_> = list
        .as_chunks::<3>()
        .0
        .iter()
        .take(num_components.into())
        .map(|&[id, of, _]| Component { id, horizontal: of >> 4, vertical: of & 15 })
        .collect();
    let is_odd = |c: &Component| !(1..=4).contains(&c.horizontal) || !(1..=4).contains(&c.vertical);
    if components.len() < num_components.into() || components.iter().any(is_odd) {
        return Err(damaged("JPEG frame header"));
    }
    Ok(Frame { width: width.into(), height: height.into(), components, progressive: code == 0xc2 })
}
