//! Bounds-checked reading of little-endian bytes.

/// A cursor that never reads past its end and never promises memory that the bytes cannot fill.
#[derive(Debug, Clone)]
pub(crate) struct ByteReader<'a> {
    bytes: &'a [u8],
    offset: usize,
}

/// The bytes end before the value does, or a count is larger than what is left.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct OutOfBytes {
    pub(crate) offset: usize,
}

impl<'a> ByteReader<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, offset: 0 }
    }

    pub(crate) fn offset(&self) -> usize {
        self.offset
    }

    pub(crate) fn is_at_end(&self) -> bool {
        self.offset == self.bytes.len()
    }

    pub(crate) fn take(&mut self, num_bytes: usize) -> Result<&'a [u8], OutOfBytes> {
        let rest = &self.bytes[self.offset..];
        let taken = rest.get(..num_bytes).ok_or(OutOfBytes { offset: self.offset })?;
        self.offset += num_bytes;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], OutOfBytes> {
        Ok(self.take(N)?.try_into().expect("N bytes were taken"))
    }

    pub(crate) fn u8(&mut self) -> Result<u8, OutOfBytes> {
        Ok(self.array::<1>()?[0])
    }

    pub(crate) fn u32(&mut self) -> Result<u32, OutOfBytes> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    pub(crate) fn i32(&mut self) -> Result<i32, OutOfBytes> {
        Ok(i32::from_le_bytes(self.array()?))
    }

    pub(crate) fn u64(&mut self) -> Result<u64, OutOfBytes> {
        Ok(u64::from_le_bytes(self.array()?))
    }

    pub(crate) fn f32(&mut self) -> Result<f32, OutOfBytes> {
        Ok(f32::from_le_bytes(self.array()?))
    }

    pub(crate) fn f64(&mut self) -> Result<f64, OutOfBytes> {
        Ok(f64::from_le_bytes(self.array()?))
    }

    /// A count of records of at least `min_record_bytes` each, which must fit into what is left:
    /// safe to allocate for.
    pub(crate) fn count(&mut self, min_record_bytes: usize) -> Result<usize, OutOfBytes> {
        let offset = self.offset;
        let count = self.u64()?;
        let left = (self.bytes.len() - self.offset) as u64;
        if count > left / min_record_bytes.max(1) as u64 {
            return Err(OutOfBytes { offset });
        }
        Ok(count as usize)
    }

    /// Bytes up to the next zero, which is skipped.
    pub(crate) fn zero_terminated(&mut self) -> Result<&'a [u8], OutOfBytes> {
        let rest = &self.bytes[self.offset..];
        let length = rest.iter().position(|&b| b == 0);
        let length = length.ok_or(OutOfBytes { offset: self.offset })?;
        let taken = self.take(length)?;
        self.take(1)?;
        Ok(taken)
    }
}
