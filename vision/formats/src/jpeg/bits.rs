//! Codes of unequal length, one behind the other.

use super::tables::Huffman;

/// Bits from the highest; a byte of ones is followed by a zero byte (F.1.2.3).
pub(super) struct BitWriter<'a> {
    bytes: &'a mut Vec<u8>,
    pending: u64,
    num_pending: u32,
}

impl<'a> BitWriter<'a> {
    pub(super) fn new(bytes: &'a mut Vec<u8>) -> Self {
        Self { bytes, pending: 0, num_pending: 0 }
    }

    /// The low `count` bits of `bits`.
    fn put(&mut self, bits: u32, count: u32) {
        self.pending = self.pending << count | u64::from(bits);
        self.num_pending += count;
        while self.num_pending >= 8 {
            self.num_pending -= 8;
            let byte = (self.pending >> self.num_pending) as u8;
            self.bytes.push(byte);
            if byte == 0xff {
                self.bytes.push(0);
            }
        }
    }

    pub(super) fn put_symbol(&mut self, codes: &Huffman, symbol: u8) {
        let (code, len) = codes.code(symbol);
        self.put(code, len);
    }

    /// A symbol that ends in the length of `value`, and `value` in as many bits, negative ones less
    /// one (F.1.2.1.1).
    pub(super) fn put_coded(&mut self, codes: &Huffman, symbol: u8, value: i32) {
        let len = 32 - value.unsigned_abs().leading_zeros();
        self.put_symbol(codes, symbol | len as u8);
        let bits = if value < 0 { value - 1 } else { value };
        self.put(bits as u32 & ((1 << len) - 1), len);
    }

    /// Ones up to the next byte.
    pub(super) fn finish(mut self) {
        let missing = (8 - self.num_pending % 8) % 8;
        self.put((1 << missing) - 1, missing);
    }
}
