//! Whether a JPEG holds all of its picture.
//!
//! Decoders go on with zeros where entropy-coded bytes are missing and answer gray or smeared
//! blocks. So the blocks of every sequential scan are counted: Huffman codes are followed without
//! their coefficients being computed, at a small part of the cost of decoding. Of a progressive
//! image the scans are counted instead: its coefficients must all have come to their last bit. A
//! last scan that is cut short, of a file that ends with an end marker all the same, costs the
//! last bit of some coefficients and is let pass.

use super::DecodeError;
use super::frame::{Frame, read_frame};
use super::huffman::{BitReader, HuffmanTable};
use super::segments::{Segments, damaged, marker, next_marker, truncated};

/// Walks all segments and scans to the end marker.
pub(super) fn check_complete_jpeg(bytes: &[u8]) -> Result<Frame, DecodeError> {
    let mut segments = Segments::new(bytes);
    let mut frame: Option<Frame> = None;
    let mut tables = Tables::default();
    let mut told = Told::nothing();
    while let Some(segment) = segments.next()? {
        match (segment.code, &frame) {
            (code, None) if marker::is_frame(code) => {
                frame = Some(read_frame(code, segment.body)?);
            }
            (marker::DHT, _) => tables.define(segment.body)?,
            (marker::DRI, _) => {
                let interval = segment.body.first_chunk().ok_or_else(|| damaged("JPEG DRI"))?;
                tables.restart_interval = usize::from(u16::from_be_bytes(*interval));
            }
            (marker::SOS, Some(frame)) => {
                let scan = Scan::read(frame, segment.body)?;
                told.add(&scan)?;
                if !frame.progressive {
                    tables.count(frame, &scan, segment.rest)?;
                }
            }
            (marker::SOS, None) => return Err(damaged("JPEG scan before its frame header")),
            _ => {}
        }
    }
    let frame = frame.ok_or_else(|| damaged("JPEG without frame header"))?;
    told.check(&frame)?;
    Ok(frame)
}

/// A scan header (B.2.3).
struct Scan {
    /// Index in the frame, DC table and AC table of every component.
    components: Vec<(usize, usize, usize)>,
    /// Coefficients in zigzag order.
    first: usize,
    last: usize,
    /// Bits that are still to come.
    low: u8,
}

impl Scan {
    fn read(frame: &Frame, body: &[u8]) -> Result<Self, DecodeError> {
        let bad = || damaged("JPEG scan header");
        let (&number, rest) = body.split_first().ok_or_else(bad)?;
        let (list, rest) = rest.split_at_checked(2 * usize::from(number)).ok_or_else(bad)?;
        let [first, last, bits, ..] = *rest else { return Err(bad()) };
        let components = list.as_chunks::<2>().0.iter().map(|&[id, of]| {
            let index = frame.components.iter().position(|component| component.id == id);
            Ok((index.ok_or_else(bad)?, usize::from(of >> 4), usize::from(of & 15)))
        });
        let components: Vec<_> = components.collect::<Result<_, DecodeError>>()?;
        // A sequential scan has all coefficients, whatever it says.
        let (first, last, low) =
            if frame.progressive { (first, last, bits & 15) } else { (0, 63, 0) };
        if components.is_empty() || first > last || last > 63 {
            return Err(bad());
        }
        Ok(Self { components, first: first.into(), last: last.into(), low })
    }
}

/// Which bits of which coefficients have come: per component, the bits that are still missing.
struct Told([[Option<u8>; 64]; 4]);

impl Told {
    fn nothing() -> Self {
        Self([[None; 64]; 4])
    }

    fn add(&mut self, scan: &Scan) -> Result<(), DecodeError> {
        for (index, ..) in &scan.components {
            let told = self.0.get_mut(*index).ok_or_else(|| damaged("JPEG scan header"))?;
            told[scan.first..=scan.last].fill(Some(scan.low));
        }
        Ok(())
    }

    fn check(&self, frame: &Frame) -> Result<(), DecodeError> {
        let whole = [Some(0); 64];
        let missing = self.0.iter().take(frame.components.len()).filter(|told| **told != whole);
        match missing.count() {
            0 => Ok(()),
            n => Err(truncated(&format!("{n} of {} channels lack scans", frame.components.len()))),
        }
    }
}

/// What scans are coded with.
#[derive(Default)]
struct Tables {
    dc: [Option<HuffmanTable>; 4],
    ac: [Option<HuffmanTable>; 4],
    /// MCUs; 0: the scan is one interval.
    restart_interval: usize,
}

impl Tables {
    /// A DHT segment (B.2.4.2).
    fn define(&mut self, mut body: &[u8]) -> Result<(), DecodeError> {
        let bad = || damaged("JPEG Huffman table");
        while let Some((&head, rest)) = body.split_first() {
            let (counts, rest) = rest.split_first_chunk::<16>().ok_or_else(bad)?;
            let number = counts.iter().map(|&count| usize::from(count)).sum();
            let (symbols, rest) = rest.split_at_checked(number).ok_or_else(bad)?;
            let tables = if head >> 4 == 0 { &mut self.dc } else { &mut self.ac };
            let table = tables.get_mut(usize::from(head & 15)).ok_or_else(bad)?;
            *table = Some(HuffmanTable::new(counts, symbols).ok_or_else(bad)?);
            body = rest;
        }
        Ok(())
    }

    /// Follows the codes of a sequential scan to its last block (A.2, E.2.4).
    fn count(&self, frame: &Frame, scan: &Scan, data: &[u8]) -> Result<(), DecodeError> {
        let bad = || damaged("JPEG scan without its Huffman table");
        let mut blocks = Vec::new();
        for &(index, dc, ac) in &scan.components {
            let dc = self.dc.get(dc).and_then(Option::as_ref).ok_or_else(bad)?;
            let ac = self.ac.get(ac).and_then(Option::as_ref).ok_or_else(bad)?;
            let number = if scan.components.len() == 1 {
                1
            } else {
                frame.components[index].num_blocks_per_mcu()
            };
            blocks.extend(std::iter::repeat_n((dc, ac), number));
        }
        let num_mcus = match scan.components[..] {
            [(index, ..)] => frame.num_blocks_alone(index),
            _ => frame.num_mcus(),
        };
        let interval = if self.restart_interval == 0 { num_mcus } else { self.restart_interval };
        let (mut done, mut start) = (0, 0);
        while done < num_mcus {
            let end = next_marker(data, start).ok_or_else(|| truncated("no end marker"))?;
            let mut bits = BitReader::new(&data[start..end - 1]);
            for _ in 0..interval.min(num_mcus - done) {
                for (dc, ac) in &blocks {
                    bits.skip_block(dc, ac).ok_or_else(|| damaged("JPEG scan: no such code"))?;
                }
                if bits.is_beyond_end() {
                    let detail = format!("a scan ends after {done} of {num_mcus} MCUs");
                    return Err(truncated(&detail));
                }
                done += 1;
            }
            if done < num_mcus && !marker::is_restart(data[end]) {
                let detail = format!("a scan ends after {done} of {num_mcus} MCUs");
                return Err(truncated(&detail));
            }
            start = end + 1;
        }
        Ok(())
    }
}
