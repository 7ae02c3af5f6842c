//! Bytes by the hash of their content.
//!
//! A blob is written to a temporary file, synced, renamed, and its folder is synced, before
//! anything may refer to it. So what a row names is always whole.

use std::{
    fs::{self, File},
    io::{self, Read, Write},
    path::{Path, PathBuf},
    sync::Arc,
    time::SystemTime,
};

use sha2::{Digest, Sha256};
use tokio::sync::RwLock;
use uuid::Uuid;
use volery_api::MapFile;

/// The blobs of a data folder.
#[derive(Debug, Clone)]
pub(crate) struct Blobs {
    blobs: PathBuf,
    tmp: PathBuf,
    /// Small copies of photos; they can be made anew.
    pub(super) thumbnails: PathBuf,
    reserve: u64,
    /// Read while a blob comes into place, written while old ones are deleted.
    pub(super) gate: Arc<RwLock<()>>,
}

/// A blob that is safe on the disk.
#[derive(Debug, Clone)]
pub(crate) struct Blob {
    pub(crate) sha256: String,
    pub(crate) size: u64,
}

impl Blobs {
    /// Creates the folders and drops what a crash left half-written.
    pub(crate) fn open(data: &Path, reserve: u64) -> io::Result<Self> {
        let (blobs, tmp, thumbnails) =
            (data.join("blobs"), data.join("tmp"), data.join("thumbnails"));
        if tmp.exists() {
            fs::remove_dir_all(&tmp)?;
        }
        fs::create_dir_all(&tmp)?;
        fs::create_dir_all(&blobs)?;
        fs::create_dir_all(&thumbnails)?;
        for prefix in 0..=255_u8 {
            fs::create_dir_all(blobs.join(format!("{prefix:02x}")))?;
        }
        sync_folder(&blobs)?;
        sync_folder(data)?;
        Ok(Self { blobs, tmp, thumbnails, reserve, gate: Arc::default() })
    }

    /// Where a blob is; `sha256` comes from a row or from [`Self::put`].
    pub(crate) fn path(&self, sha256: &str) -> PathBuf {
        self.blobs.join(sha256.get(..2).unwrap_or("00")).join(sha256)
    }

    /// Where the blobs are whose hash begins with `prefix`.
    pub(super) fn folder(&self, prefix: u8) -> PathBuf {
        self.blobs.join(format!("{prefix:02x}"))
    }

    /// A file name that nobody uses, on the file system of the blobs.
    pub(crate) fn temporary(&self) -> PathBuf {
        self.tmp.join(Uuid::now_v7().to_string())
    }

    /// Fails when `size` more bytes would eat into the reserve.
    pub(crate) fn check_space(&self, size: u64) -> io::Result<()> {
        let stat = rustix::fs::statvfs(&self.blobs)?;
        let free = stat.f_bavail.saturating_mul(stat.f_frsize);
        if free < self.reserve.saturating_add(size) {
            return Err(io::ErrorKind::StorageFull.into());
        }
        Ok(())
    }

    /// Keeps `bytes`. Blocks.
    pub(crate) fn put(&self, bytes: &[u8]) -> io::Result<Blob> {
        self.put_reader(bytes)
    }

    /// Keeps a copy of a file. Blocks.
    pub(crate) fn put_file(&self, path: &Path) -> io::Result<Blob> {
        self.put_reader(File::open(path)?)
    }

    fn put_reader(&self, mut reader: impl Read) -> io::Result<Blob> {
        self.check_space(0)?;
        let temporary = self.temporary();
        let result = self.write(&mut reader, &temporary);
        if result.is_err() {
            let _ = fs::remove_file(&temporary);
        }
        result
    }

    fn write(&self, reader: &mut impl Read, temporary: &Path) -> io::Result<Blob> {
        let mut file = File::create_new(temporary)?;
        let mut hash = Sha256::new();
        let mut buffer = vec![0; 256 << 10];
        let mut size = 0;
        loop {
            let len = reader.read(&mut buffer)?;
            if len == 0 {
                break;
            }
            hash.update(&buffer[..len]);
            file.write_all(&buffer[..len])?;
            size += len as u64;
        }
        let sha256 = hex(&hash.finalize());
        let path = self.path(&sha256);
        let _gate = self.gate.blocking_read();
        if fs::metadata(&path).is_ok_and(|known| known.len() == size) {
            // Young again: nothing deletes it before its new row comes.
            File::open(&path)?.set_modified(SystemTime::now())?;
            fs::remove_file(temporary)?;
        } else {
            file.sync_all()?;
            fs::rename(temporary, &path)?;
        }
        // Also for a known blob: another upload may have renamed it without having synced yet.
        sync_folder(path.parent().unwrap_or(&self.blobs))?;
        Ok(Blob { sha256, size })
    }

    /// Keeps every file below `folder`; links and odd names are errors. Blocks.
    pub(crate) fn put_folder(&self, folder: &Path) -> io::Result<Vec<MapFile>> {
        let mut files = Vec::new();
        self.put_below(folder, "", &mut files)?;
        files.sort_by(|a, b| a.path.cmp(&b.path));
        Ok(files)
    }

    fn put_below(&self, folder: &Path, prefix: &str, files: &mut Vec<MapFile>) -> io::Result<()> {
        for entry in fs::read_dir(folder)? {
            let entry = entry?;
            let name = entry.file_name().into_string().map_err(|_| io::ErrorKind::InvalidData)?;
            let path = format!("{prefix}{name}");
            let kind = entry.file_type()?;
            if kind.is_dir() {
                self.put_below(&entry.path(), &format!("{path}/"), files)?;
            } else if kind.is_file() {
                let Blob { sha256, size } = self.put_file(&entry.path())?;
                files.push(MapFile { path, sha256, size });
            } else {
                return Err(io::Error::other(format!("{path} is neither a file nor a folder")));
            }
        }
        Ok(())
    }

    /// Makes `folder` hold `files`, by links to the blobs. All or nothing. Blocks.
    pub(crate) fn lay_out(&self, files: &[MapFile], folder: &Path) -> io::Result<()> {
        if folder.exists() {
            return Ok(());
        }
        let temporary = self.temporary();
        for file in files {
            let target = temporary.join(&file.path);
            if let Some(parent) = target.parent() {
                fs::create_dir_all(parent)?;
            }
            let blob = self.path(&file.sha256);
            if fs::hard_link(&blob, &target).is_err() {
                fs::copy(&blob, &target)?;
            }
        }
        if let Some(parent) = folder.parent() {
            fs::create_dir_all(parent)?;
        }
        match fs::rename(&temporary, folder) {
            Err(_) if folder.exists() => fs::remove_dir_all(&temporary),
            result => result,
        }
    }
}

/// Writes a small file so that a crash leaves the old one or the new one.
pub(crate) fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let temporary = path.with_extension("partial");
    let mut file = File::create(&temporary)?;
    file.write_all(bytes)?;
    file.sync_all()?;
    fs::rename(&temporary, path)?;
    path.parent().map_or(Ok(()), sync_folder)
}

pub(super) fn sync_folder(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

/// Lower-case hexadecimal.
pub(crate) fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder() -> PathBuf {
        let folder = std::env::temp_dir().join(format!("volery-blobs-{}", Uuid::now_v7()));
        fs::create_dir_all(&folder).unwrap();
        folder
    }

    #[test]
    fn a_blob_is_named_by_its_content_and_kept_once() {
        let data = folder();
        let blobs = Blobs::open(&data, 0).unwrap();
        let first = blobs.put(b"abc").unwrap();
        let second = blobs.put(b"abc").unwrap();
        assert_eq!(
            first.sha256,
            "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
        );
        assert_eq!(first.sha256, second.sha256);
        assert_eq!(fs::read(blobs.path(&first.sha256)).unwrap(), b"abc");
        assert_eq!(fs::read_dir(data.join("tmp")).unwrap().count(), 0);
        fs::remove_dir_all(data).unwrap();
    }

    #[test]
    fn a_full_disk_is_an_error_before_anything_is_written() {
        let data = folder();
        let blobs = Blobs::open(&data, u64::MAX).unwrap();
        assert_eq!(blobs.put(b"abc").unwrap_err().kind(), io::ErrorKind::StorageFull);
        fs::remove_dir_all(data).unwrap();
    }

    #[test]
    fn a_folder_laid_out_again_is_the_same() {
        let data = folder();
        let blobs = Blobs::open(&data, 0).unwrap();
        let source = data.join("source");
        fs::create_dir_all(source.join("colmap")).unwrap();
        fs::write(source.join("map.json"), "{}").unwrap();
        fs::write(source.join("colmap/images.txt"), "# none").unwrap();
        let files = blobs.put_folder(&source).unwrap();
        let names: Vec<_> = files.iter().map(|file| file.path.as_str()).collect();
        assert_eq!(names, ["colmap/images.txt", "map.json"]);
        let target = data.join("maps/one/1");
        blobs.lay_out(&files, &target).unwrap();
        assert_eq!(fs::read_to_string(target.join("colmap/images.txt")).unwrap(), "# none");
        fs::remove_dir_all(data).unwrap();
    }
}
