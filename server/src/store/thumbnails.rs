//! Small copies of photos, by the hash of the photo. They can be made anew at any time and go with
//! the blob of the photo.

use std::{fs, io, path::PathBuf};

use super::blobs::Blobs;

/// Longest sides that are made, pixels. Few, so that the copies of a photo stay few.
pub(crate) const THUMBNAIL_SIZES: [u32; 5] = [64, 128, 256, 512, 1024];

impl Blobs {
    /// Where the copy of a photo is, once it was made.
    pub(crate) fn thumbnail(&self, sha256: &str, size: u32) -> PathBuf {
        self.thumbnails.join(format!("{sha256}-{size}.png"))
    }

    /// Keeps a copy of a photo that is there, whole or not at all. Blocks.
    pub(crate) fn put_thumbnail(&self, sha256: &str, size: u32, bytes: &[u8]) -> io::Result<()> {
        self.check_space(bytes.len() as u64)?;
        // Until the copy is in place, nobody deletes the photo and its copies.
        let _gate = self.gate.blocking_read();
        fs::metadata(self.path(sha256))?;
        let temporary = self.temporary();
        let kept = fs::write(&temporary, bytes)
            .and_then(|()| fs::File::open(&temporary)?.sync_all())
            .and_then(|()| fs::rename(&temporary, self.thumbnail(sha256, size)));
        if kept.is_err() {
            let _ = fs::remove_file(&temporary);
        }
        kept
    }

    /// Deletes the copies of a photo that is gone.
    pub(super) async fn drop_thumbnails(&self, sha256: &str) {
        for size in THUMBNAIL_SIZES {
            // Most were never made.
            let _ = tokio::fs::remove_file(self.thumbnail(sha256, size)).await;
        }
    }
}
