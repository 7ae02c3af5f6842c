//! The directory of a zip archive is bounded before it is read: every entry of it takes memory, and
//! an archive of a few gigabytes has room for a hundred million of them.

use std::{
    cell::Cell,
    fs::File,
    io::{self, Read, Seek, SeekFrom},
    os::unix::fs::FileExt,
    path::Path,
    rc::Rc,
};

use volery_api::Limits;
use zip::ZipArchive;

use crate::error::{ApiError, ApiResult, Code};

/// Signature of the record that ends an archive (APPNOTE.TXT 4.3.16).
const END: [u8; 4] = *b"PK\x05\x06";
/// Of the record with 64-bit counts, and of what leads to it (4.3.14, 4.3.15).
const END64: [u8; 4] = *b"PK\x06\x06";
const LOCATOR64: [u8; 4] = *b"PK\x06\x07";

/// Bytes of these records without comments.
const END_SIZE: usize = 22;
const END64_SIZE: usize = 56;
const LOCATOR64_SIZE: usize = 20;

/// The end record and the longest comment.
const MAX_TAIL: u64 = END_SIZE as u64 + u16::MAX as u64;

/// Most bytes of the directory per entry that an archive may have: header, path, extra fields.
const MAX_ENTRY_HEADER: u64 = 1024;

/// Opens an archive whose directory is within the limits.
///
/// Whoever parses an archive may take any end record for the true one, and believe its counts. So
/// there must be only one, and while the directory is read all before it looks like zeros.
///
/// # Errors
///
/// `not_an_archive`; `too_many_entries` by the number of entries or the size of the directory.
pub(super) fn open_archive(path: &Path, limits: &Limits) -> ApiResult<ZipArchive<Archive>> {
    let file = File::open(path)?;
    let size = file.metadata()?.len();
    let start = directory_start(&file, size, limits.archive_entries)?;
    let hidden = Rc::new(Cell::new(start));
    let archive = Archive { file, size, position: 0, hidden: Rc::clone(&hidden) };
    let zip = ZipArchive::new(archive).map_err(|error| not_an_archive(error.to_string()))?;
    hidden.set(0);
    Ok(zip)
}

/// An archive whose first bytes may be hidden.
#[derive(Debug)]
pub(super) struct Archive {
    file: File,
    size: u64,
    position: u64,
    /// Bytes before this position read as zeros.
    hidden: Rc<Cell<u64>>,
}

impl Read for Archive {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let zeros = self.hidden.get().saturating_sub(self.position).min(buffer.len() as u64);
        let count = if zeros > 0 {
            buffer[..zeros as usize].fill(0);
            zeros as usize
        } else {
            self.file.read_at(buffer, self.position)?
        };
        self.position += count as u64;
        Ok(count)
    }
}

impl Seek for Archive {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let position = match to {
            SeekFrom::Start(position) => Some(position),
            SeekFrom::End(offset) => self.size.checked_add_signed(offset),
            SeekFrom::Current(offset) => self.position.checked_add_signed(offset),
        };
        self.position = position.ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.position)
    }
}

/// Where the directory begins, by the only end record.
fn directory_start(file: &File, size: u64, max_entries: u64) -> ApiResult<u64> {
    let tail_start = size.saturating_sub(MAX_TAIL + (END64_SIZE + LOCATOR64_SIZE) as u64);
    let tail = read(file, tail_start, size)?;
    let end = find(&tail, END)
        .last()
        .filter(|end| end + END_SIZE <= tail.len())
        .ok_or_else(|| not_an_archive("it has no end record".to_owned()))?;
    let end64 = end.checked_sub(END64_SIZE + LOCATOR64_SIZE).filter(|&at| {
        tail[at..].starts_with(&END64) && tail[at + END64_SIZE..].starts_with(&LOCATOR64)
    });
    // A field of all ones stands for one of the record with 64 bits, where there is one.
    let field = |at, bytes| match number(&tail[end + at..], bytes) {
        ones if end64.is_some() && ones == u64::MAX >> (64 - 8 * bytes) => 0,
        value => value,
    };
    let field64 = |at: usize| end64.map_or(0, |end64| number(&tail[end64 + at..], 8));
    // On this disk and in all; readers differ in which they believe.
    let entries = [field(8, 2), field(10, 2), field64(24), field64(32)].into_iter().max();
    let entries = entries.unwrap_or_default();
    if entries > max_entries {
        return Err(too_many(format!("{entries} entries; at most {max_entries}")));
    }
    let bytes = field(12, 4).max(field64(40));
    let max_bytes = max_entries.saturating_mul(MAX_ENTRY_HEADER);
    if bytes > max_bytes {
        return Err(too_many(format!("a directory of {bytes} bytes; at most {max_bytes}")));
    }
    let start = (tail_start + end64.unwrap_or(end) as u64)
        .checked_sub(bytes)
        .ok_or_else(|| not_an_archive("its directory is longer than the archive".to_owned()))?;
    let shown = read(file, start, size)?;
    let num_ends = find(&shown, END).count();
    let num_ends64 = find(&shown, END64).count();
    if num_ends != 1 || num_ends64 != usize::from(end64.is_some()) {
        return Err(not_an_archive("it has more than one end".to_owned()));
    }
    Ok(start)
}

fn read(file: &File, start: u64, end: u64) -> io::Result<Vec<u8>> {
    let mut bytes = vec![0; (end - start) as usize];
    file.read_exact_at(&mut bytes, start)?;
    Ok(bytes)
}

/// Positions of a signature, first to last.
fn find(bytes: &[u8], signature: [u8; 4]) -> impl Iterator<Item = usize> {
    bytes.windows(4).enumerate().filter(move |(_, four)| *four == signature).map(|(at, _)| at)
}

/// A little-endian number of at most eight bytes.
fn number(bytes: &[u8], size: usize) -> u64 {
    bytes[..size].iter().rev().fold(0, |number, &byte| number << 8 | u64::from(byte))
}

fn not_an_archive(detail: String) -> ApiError {
    let detail = format!("the body is not a zip archive: {detail}");
    ApiError::new(Code::Unprocessable("not_an_archive"), detail)
}

fn too_many(detail: String) -> ApiError {
    ApiError::new(Code::Unprocessable("too_many_entries"), detail)
}
