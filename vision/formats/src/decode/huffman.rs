//! Huffman codes of JPEG scans, followed but not decoded (ITU-T T.81, annexes C and F).

/// Codes up to this length are found by one look.
const LOOK: u32 = 10;

/// Code lengths and symbols.
#[derive(Debug, Clone)]
pub(super) struct HuffmanTable {
    /// By the next [`LOOK`] bits: length and symbol; length 0 for longer codes.
    short: Vec<(u8, u8)>,
    /// By length: one beyond the last code, moved to 16 bits; what to add to a code for the place
    /// of its symbol.
    long: [(u32, i32); 17],
    symbols: Vec<u8>,
}

impl HuffmanTable {
    /// From the number of codes of each length and the symbols in the order of the codes; `None`
    /// if there are more codes than bits (C.2).
    pub(super) fn new(counts: &[u8; 16], symbols: &[u8]) -> Option<Self> {
        let mut table =
            Self { short: vec![(0, 0); 1 << LOOK], long: [(0, 0); 17], symbols: symbols.to_vec() };
        let (mut code, mut place) = (0_u32, 0_usize);
        for (length, &count) in (1_u32..).zip(counts) {
            table.long[length as usize].1 = place as i32 - code as i32;
            for &symbol in symbols.get(place..place + usize::from(count))? {
                if code >> length != 0 {
                    return None;
                }
                if length <= LOOK {
                    let first = (code << (LOOK - length)) as usize;
                    table.short[first..first + (1 << (LOOK - length))].fill((length as u8, symbol));
                }
                code += 1;
            }
            place += usize::from(count);
            table.long[length as usize].0 = code << (16 - length);
            code <<= 1;
        }
        Some(table)
    }

    /// Length and symbol of the code that `bits`, 16 of them, begin with.
    #[inline]
    fn find(&self, bits: u32) -> Option<(u32, u8)> {
        let (length, symbol) = self.short[(bits >> (16 - LOOK)) as usize];
        if length != 0 {
            return Some((length.into(), symbol));
        }
        let length = (LOOK + 1..=16).find(|&length| bits < self.long[length as usize].0)?;
        let place = (bits >> (16 - length)) as i32 + self.long[length as usize].1;
        Some((length, *self.symbols.get(usize::try_from(place).ok()?)?))
    }
}

/// Entropy-coded bytes up to a marker, as bits; zeros beyond the end.
#[derive(Debug)]
pub(super) struct BitReader<'a> {
    data: &'a [u8],
    /// The next bits, the first one lowest but `count - 1`.
    buffer: u64,
    count: u32,
    /// How many of `count` bits are not in `data`.
    padding: u32,
}

impl<'a> BitReader<'a> {
    pub(super) fn new(data: &'a [u8]) -> Self {
        Self { data, buffer: 0, count: 0, padding: 0 }
    }

    /// Whether bits have been taken that are not there.
    pub(super) fn is_beyond_end(&self) -> bool {
        self.count < self.padding
    }

    /// At least 32 bits.
    #[inline]
    fn fill(&mut self) {
        if self.count >= 32 {
            return;
        }
        if let Some((chunk, rest)) = self.data.split_first_chunk::<4>() {
            let bytes = u32::from_be_bytes(*chunk);
            // No byte is 0xff: none of the inverted bytes is zero.
            if (!bytes).wrapping_sub(0x0101_0101) & bytes & 0x8080_8080 == 0 {
                self.buffer = self.buffer << 32 | u64::from(bytes);
                self.count += 32;
                self.data = rest;
                return;
            }
        }
        while self.count < 32 {
            let byte = match self.data {
                // A stuffed zero, or fill bytes before the marker.
                [0xff, rest @ ..] => {
                    self.data = rest.get(1..).unwrap_or_default();
                    if rest.first() == Some(&0) { Some(0xff) } else { None }
                }
                [byte, rest @ ..] => {
                    self.data = rest;
                    Some(*byte)
                }
                [] => None,
            };
            self.padding += if byte.is_none() { 8 } else { 0 };
            self.buffer = self.buffer << 8 | u64::from(byte.unwrap_or(0));
            self.count += 8;
        }
    }

    /// Takes a code and the extra bits that its symbol's low half counts; answers the symbol.
    #[inline]
    fn skip_code(&mut self, table: &HuffmanTable) -> Option<u8> {
        self.fill();
        let next = (self.buffer >> (self.count - 16)) as u32 & 0xffff;
        let (length, symbol) = table.find(next)?;
        self.count -= length + u32::from(symbol & 15);
        Some(symbol)
    }

    /// Takes the 64 coefficients of a block (F.2.2); `None` for a code that is not in the table.
    #[inline]
    pub(super) fn skip_block(&mut self, dc: &HuffmanTable, ac: &HuffmanTable) -> Option<()> {
        self.skip_code(dc)?;
        let mut coefficient = 1;
        while coefficient < 64 {
            match self.skip_code(ac)? {
                0xf0 => coefficient += 16,
                symbol if symbol & 15 == 0 => break,
                symbol => coefficient += usize::from(symbol >> 4) + 1,
            }
        }
        Some(())
    }
}
