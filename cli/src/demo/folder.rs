//! The folder of a demo: nothing but an earlier demo is replaced.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use volery_pipeline::{PipelineError, error::code};

/// Marks a folder as a demo's; locked as long as one runs in it.
const MARK: &str = ".volery-demo";

/// A folder that this demo alone works in.
#[derive(Debug, Clone)]
pub(crate) struct DemoFolder {
    path: PathBuf,
    _lock: Arc<File>,
}

impl DemoFolder {
    /// Takes a folder that is new, empty, or an earlier demo's, and empties its `folders`.
    pub(crate) fn claim(path: &Path, folders: &[&str]) -> Result<Self, PipelineError> {
        let mark = path.join(MARK);
        let entries = match fs::read_dir(path) {
            Ok(entries) => entries.count(),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => 0,
            Err(error) => return Err(PipelineError::io(path, &error)),
        };
        if entries > 0 && !mark.exists() {
            return Err(PipelineError::new(
                code::BAD_INPUT,
                format!("{} is not empty, and not of an earlier demo", path.display()),
                "name a new folder with --out",
            ));
        }
        fs::create_dir_all(path).map_err(|e| PipelineError::io(path, &e))?;
        let opened = OpenOptions::new().write(true).create(true).truncate(false).open(&mark);
        let lock = opened.map_err(|e| PipelineError::io(&mark, &e))?;
        match lock.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => {
                return Err(PipelineError::new(
                    code::BAD_INPUT,
                    format!("another demo runs in {}", path.display()),
                    "end it, or name another folder with --out",
                ));
            }
            Err(TryLockError::Error(error)) => return Err(PipelineError::io(&mark, &error)),
        }
        for name in folders {
            renew(&path.join(name))?;
        }
        Ok(Self { path: path.to_owned(), _lock: Arc::new(lock) })
    }

    pub(crate) fn join(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    pub(crate) fn write(&self, name: &str, bytes: &[u8]) -> Result<PathBuf, PipelineError> {
        let path = self.join(name);
        fs::write(&path, bytes).map_err(|e| PipelineError::io(&path, &e))?;
        Ok(path)
    }
}

fn renew(folder: &Path) -> Result<(), PipelineError> {
    if folder.exists() {
        fs::remove_dir_all(folder).map_err(|e| PipelineError::io(folder, &e))?;
    }
    fs::create_dir_all(folder).map_err(|e| PipelineError::io(folder, &e))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_of_others_stays_as_it_is() {
        let folder = std::env::temp_dir().join(format!("volery-demo-test-{}", std::process::id()));
        fs::create_dir_all(folder.join("data")).unwrap();
        fs::write(folder.join("data/letter.txt"), "mine").unwrap();
        let refused = DemoFolder::claim(&folder, &["data"]).unwrap_err();
        assert_eq!(refused.code, code::BAD_INPUT);
        assert_eq!(fs::read(folder.join("data/letter.txt")).unwrap(), b"mine");

        let own = folder.join("new");
        let first = DemoFolder::claim(&own, &["data"]).unwrap();
        first.write("data/old", b"of the first").unwrap();
        assert!(DemoFolder::claim(&own, &["data"]).unwrap_err().detail.contains("another demo"));
        drop(first);
        let second = DemoFolder::claim(&own, &["data"]).unwrap();
        assert!(!second.join("data/old").exists());
        fs::remove_dir_all(folder).unwrap();
    }
}
