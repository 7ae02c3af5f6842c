//! Finished units of work, found again by the hash of what they were made from.

use std::{
    fs,
    path::{Path, PathBuf},
};

use volery_scene::Stage;

use crate::{atomic::write_parts, error::PipelineError};

/// Hash of inputs, options and code.
pub(crate) type Key = blake3::Hash;

/// Collects what a unit is made from.
pub(crate) struct KeyMaker(blake3::Hasher);

impl KeyMaker {
    /// For a stage; starts with the hash of the code.
    pub(crate) fn new(stage: &str) -> Self {
        Self(blake3::Hasher::new()).with(env!("VOLERY_CODE_HASH").as_bytes()).with(stage.as_bytes())
    }

    /// Adds a part; its length goes in too, so that parts cannot run into each other.
    pub(crate) fn with(mut self, part: &[u8]) -> Self {
        self.0.update(&(part.len() as u64).to_le_bytes()).update(part);
        self
    }

    /// Adds the text of a value that has one for every state (its `Debug`).
    pub(crate) fn with_debug(self, value: &impl std::fmt::Debug) -> Self {
        let text = format!("{value:?}");
        self.with(text.as_bytes())
    }

    /// The key.
    pub(crate) fn key(&self) -> Key {
        self.0.finalize()
    }
}

/// A folder of finished units: one file each, named by its key, its own hash in front.
pub(crate) struct Cache {
    folder: PathBuf,
}

impl Cache {
    /// In `work_dir`, for `stage`.
    pub(crate) fn open(work_dir: &Path, stage: Stage) -> Result<Self, PipelineError> {
        let folder = work_dir.join(stage.name());
        fs::create_dir_all(&folder).map_err(|e| PipelineError::io(&folder, &e))?;
        Ok(Self { folder })
    }

    /// The unit, if it is there and undamaged.
    pub(crate) fn get(&self, key: &Key) -> Option<Vec<u8>> {
        let bytes = fs::read(self.path(key)).ok()?;
        let (hash, content) = bytes.split_first_chunk::<{ blake3::OUT_LEN }>()?;
        (blake3::hash(content) == *hash).then(|| content.to_vec())
    }

    /// Whether the unit is there, damaged or not.
    pub(crate) fn has(&self, key: &Key) -> bool {
        self.path(key).exists()
    }

    /// Makes room.
    pub(crate) fn forget(&self, key: &Key) {
        // It may not be there; what stays only takes room.
        let _ = fs::remove_file(self.path(key));
    }

    /// Keeps a unit; whole or not at all.
    pub(crate) fn put(&self, key: &Key, content: &[u8]) -> Result<(), PipelineError> {
        let path = self.path(key);
        let hash = blake3::hash(content);
        write_parts(&path, &[hash.as_bytes(), content])
    }

    fn path(&self, key: &Key) -> PathBuf {
        self.folder.join(key.to_hex().as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn temporary_folder(name: &str) -> PathBuf {
        let folder =
            std::env::temp_dir().join(format!("volery-cache-{name}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        folder
    }

    #[test]
    fn a_unit_comes_back_and_a_damaged_one_does_not() {
        let folder = temporary_folder("damage");
        let cache = Cache::open(&folder, Stage::Features).unwrap();
        let key = KeyMaker::new("stage").with(b"input").key();
        assert_eq!(cache.get(&key), None);
        cache.put(&key, b"content").unwrap();
        assert_eq!(cache.get(&key).as_deref(), Some(&b"content"[..]));

        let path = cache.path(&key);
        let mut bytes = fs::read(&path).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        fs::write(&path, &bytes).unwrap();
        assert_eq!(cache.get(&key), None, "a flipped bit");
        fs::write(&path, &bytes[..10]).unwrap();
        assert_eq!(cache.get(&key), None, "a torn file");
        fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn parts_do_not_run_into_each_other() {
        let key = |parts: [&[u8]; 2]| KeyMaker::new("s").with(parts[0]).with(parts[1]).key();
        assert_ne!(key([b"ab", b"c"]), key([b"a", b"bc"]));
    }
}
