//! Bounds-checked reading of little-endian bytes.

use crate::index::IndexError;

/// A cursor that never reads past its end and never promises memory that the bytes cannot fill.
pub(crate) struct ByteReader<'a> {
    bytes: &'a [u8],
    offset: usize,
}

impl<'a> ByteReader<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, offset: 0 }
    }

    /// An error at this place.
    pub(crate) fn damaged(&self) -> IndexError {
        IndexError::Damaged { offset: self.offset }
    }

    pub(crate) fn is_at_end(&self) -> bool {
        self.offset == self.bytes.len()
    }

    pub(crate) fn take(&mut self, num_bytes: usize) -> Result<&'a [u8], IndexError> {
        let taken = self.bytes[self.offset..].get(..num_bytes).ok_or(self.damaged())?;
        self.offset += num_bytes;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], IndexError> {
        Ok(self.take(N)?.try_into().expect("N bytes were taken"))
    }

    pub(crate) fn u32(&mut self) -> Result<u32, IndexError> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    /// A finite number.
    pub(crate) fn f32(&mut self) -> Result<f32, IndexError> {
        let value = f32::from_le_bytes(self.array()?);
        if value.is_finite() { Ok(value) } else { Err(self.damaged()) }
    }

    /// A finite number.
    pub(crate) fn f64(&mut self) -> Result<f64, IndexError> {
        let value = f64::from_le_bytes(self.array()?);
        if value.is_finite() { Ok(value) } else { Err(self.damaged()) }
    }

    /// A count of records of `record_bytes` each, which must fit into what is left: safe to
    /// allocate for.
    pub(crate) fn count(&mut self, record_bytes: usize) -> Result<usize, IndexError> {
        let count = self.u32()? as usize;
        let left = self.bytes.len() - self.offset;
        if count > left / record_bytes.max(1) { Err(self.damaged()) } else { Ok(count) }
    }
}
