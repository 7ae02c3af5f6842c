//! Archives of photos: every entry is untrusted.

use std::{
    fs::File,
    io::{self, Read, Write},
    path::{Path, PathBuf},
    sync::Arc,
};

use tokio::sync::mpsc;
use uuid::Uuid;
use volery_api::{Limits, UploadResult};

use super::{
    ingest::{Incoming, TemporaryFile, ingest, name_problem, reject},
    zip_directory::open_archive,
};
use crate::{
    error::{ApiError, ApiResult, Code},
    state::App,
};

/// Entries below this size may have any ratio: a few white pixels pack well.
const MIN_BOMB: u64 = 1 << 20;

/// One entry of an archive.
enum Entry {
    Photo {
        name: String,
        file: TemporaryFile,
    },
    Bad {
        name: String,
        code: &'static str,
        detail: String,
    },
    /// The archive itself is bad.
    End(ApiError),
}

/// Adds the entries of an archive to a set, one after another.
pub(super) async fn ingest_archive(
    app: &Arc<App>,
    imageset: Uuid,
    archive: &Path,
) -> ApiResult<Vec<UploadResult>> {
    let (sender, mut entries) = mpsc::channel(1);
    let (path, app_there) = (archive.to_owned(), Arc::clone(app));
    let unpacked = tokio::task::spawn_blocking(move || {
        let temporary = || app_there.blobs.temporary();
        unpack(&path, &app_there.config.limits, temporary, |entry| {
            sender.blocking_send(entry).is_ok()
        })
    });
    let mut results = Vec::new();
    while let Some(entry) = entries.recv().await {
        results.push(match entry {
            Entry::Bad { name, code, detail } => reject(app, &name, code, detail),
            Entry::Photo { name, file } => {
                let incoming = Incoming {
                    imageset,
                    name: &name,
                    file: &file.0,
                    prior: None,
                    capture_time_ns: None,
                };
                ingest(app, &incoming).await?
            }
            Entry::End(error) => return Err(error),
        });
    }
    unpacked.await??;
    Ok(results)
}

/// Tells every entry until `tell` answers that nobody listens.
fn unpack(
    archive: &Path,
    limits: &Limits,
    temporary: impl Fn() -> PathBuf,
    mut tell: impl FnMut(Entry) -> bool,
) -> io::Result<()> {
    let bad = |code, detail: String| Entry::End(ApiError::new(Code::Unprocessable(code), detail));
    let mut zip = match open_archive(archive, limits) {
        Ok(zip) => zip,
        Err(error) => {
            tell(Entry::End(error));
            return Ok(());
        }
    };
    let packed_size = std::fs::metadata(archive)?.len();
    let mut unpacked_size = 0;
    for index in 0..zip.len() {
        let entry = match zip.by_index(index) {
            Ok(entry) => entry,
            Err(error) => {
                let name = format!("entry {index}");
                let detail = error.to_string();
                if !tell(Entry::Bad { name, code: "archive_entry_unreadable", detail }) {
                    return Ok(());
                }
                continue;
            }
        };
        if entry.is_dir() {
            continue;
        }
        let name = entry.name().to_owned();
        let is_link = entry.is_symlink();
        let packed = entry.compressed_size();
        let told = if let Some(problem) = name_problem(&name) {
            Entry::Bad { name, code: "unsafe_name", detail: problem.to_owned() }
        } else if is_link {
            let detail = "the entry is a link".to_owned();
            Entry::Bad { name, code: "archive_link", detail }
        } else {
            let max =
                limits.image_bytes.min(MIN_BOMB.max(packed.saturating_mul(limits.archive_ratio)));
            let file = TemporaryFile(temporary());
            match copy(entry, &file.0, max) {
                Ok(Some(size)) => {
                    unpacked_size += size;
                    Entry::Photo { name, file }
                }
                Ok(None) if max < limits.image_bytes => {
                    let detail =
                        format!("it unpacks to over {} times its size", limits.archive_ratio);
                    Entry::Bad { name, code: "archive_ratio", detail }
                }
                Ok(None) => {
                    let detail = format!("a photo has at most {max} bytes");
                    Entry::Bad { name, code: "too_large", detail }
                }
                Err(error) if error.kind() == io::ErrorKind::StorageFull => return Err(error),
                Err(error) => {
                    let detail = error.to_string();
                    Entry::Bad { name, code: "archive_entry_unreadable", detail }
                }
            }
        };
        if !tell(told) {
            return Ok(());
        }
        let bomb = MIN_BOMB.max(packed_size.saturating_mul(limits.archive_ratio));
        if unpacked_size > limits.archive_unpacked_bytes.min(bomb) {
            tell(bad("archive_ratio", format!("it unpacks to more than {unpacked_size} bytes")));
            return Ok(());
        }
    }
    Ok(())
}

/// Copies at most `max` bytes; `None` when there are more.
fn copy(entry: impl Read, path: &Path, max: u64) -> io::Result<Option<u64>> {
    let mut file = File::create_new(path)?;
    let size = io::copy(&mut entry.take(max + 1), &mut file)?;
    file.flush()?;
    Ok((size <= max).then_some(size))
}
