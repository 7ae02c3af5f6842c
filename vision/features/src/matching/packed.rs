//! Descriptor layouts of the kernels.

use volery_scene::{DESCRIPTOR_LEN, Descriptor};

/// Descriptors of one tile of [`PackedDescriptors`].
pub(super) const TILE: usize = 64;
/// Bytes of one tile.
pub(super) const TILE_BYTES: usize = TILE * DESCRIPTOR_LEN;
/// Queries the kernels take at once.
pub(super) const QUERIES: usize = 4;
/// Squared norm of padding: farther than any descriptor.
pub(super) const PADDING_NORM: i32 = 1 << 28;

/// Descriptors laid out for the matching kernel; made once per image, used for every pair.
#[derive(Debug, Clone)]
pub struct PackedDescriptors {
    len: usize,
    /// Row-major, padded to a whole number of tiles.
    rows: Vec<[i8; DESCRIPTOR_LEN]>,
    /// Tiles of 64 descriptors: their first four bytes, their next four bytes, and so on.
    tiles: Vec<[u8; TILE_BYTES]>,
    /// Squared norms, padded.
    norms: Vec<i32>,
}

impl PackedDescriptors {
    /// Packs `descriptors`. Bytes above 127, which RootSIFT never has, count as 127.
    pub fn new(descriptors: &[Descriptor]) -> Self {
        let padded = descriptors.len().next_multiple_of(TILE);
        let mut rows = vec![[0i8; DESCRIPTOR_LEN]; padded];
        let mut norms = vec![PADDING_NORM; padded];
        for ((row, norm), descriptor) in rows.iter_mut().zip(&mut norms).zip(descriptors) {
            *row = descriptor.map(|byte| byte.min(127) as i8);
            *norm = row.iter().map(|&v| i32::from(v) * i32::from(v)).sum();
        }
        let tiles = rows
            .chunks_exact(TILE)
            .map(|chunk| {
                let mut tile = [0u8; TILE_BYTES];
                for (column, row) in chunk.iter().enumerate() {
                    for (quad, bytes) in row.as_chunks::<4>().0.iter().enumerate() {
                        let start = (quad * TILE + column) * 4;
                        tile[start..start + 4].copy_from_slice(&bytes.map(|b| b as u8));
                    }
                }
                tile
            })
            .collect();
        Self { len: descriptors.len(), rows, tiles, norms }
    }

    /// Number of descriptors.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    pub(super) fn rows(&self) -> &[[i8; DESCRIPTOR_LEN]] {
        &self.rows
    }

    pub(super) fn tiles(&self) -> &[[u8; TILE_BYTES]] {
        &self.tiles
    }

    pub(super) fn norms(&self) -> &[i32] {
        &self.norms
    }
}
