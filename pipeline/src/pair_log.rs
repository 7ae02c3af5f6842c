//! Verified pairs, kept one by one in an append-only file: a torn tail costs only itself.

use std::{
    collections::HashMap,
    fs::{self, File, OpenOptions},
    io::Write,
    path::{Path, PathBuf},
    sync::Mutex,
};

use volery_formats::{read_two_view_geometries, write_two_view_geometries};
use volery_scene::{Stage, TwoViewGeometry};

use crate::{cache::Key, error::PipelineError};

/// A record is key, length, payload, hash of all three; little endian.
const KEY_LEN: usize = blake3::OUT_LEN;
const HEAD_LEN: usize = KEY_LEN + 4;
const HASH_LEN: usize = 8;

/// Pairs that were matched before, found by key. The payload of a pair without geometry is empty.
pub(crate) struct PairLog {
    path: PathBuf,
    known: HashMap<[u8; KEY_LEN], Vec<u8>>,
    file: Mutex<File>,
}

impl PairLog {
    /// Opens or creates the log in `work_dir` and drops what was not written whole.
    pub(crate) fn open(work_dir: &Path) -> Result<Self, PipelineError> {
        let folder = work_dir.join(Stage::Matching.name());
        let path = folder.join("pairs.log");
        let fail = |e: std::io::Error| PipelineError::io(&path, &e);
        fs::create_dir_all(&folder).map_err(fail)?;
        let bytes = if path.exists() { fs::read(&path).map_err(fail)? } else { Vec::new() };
        let mut known = HashMap::new();
        let mut whole = 0;
        while let Some((key, payload, len)) = parse_record(&bytes[whole..]) {
            known.insert(key, payload.to_vec());
            whole += len;
        }
        let file = OpenOptions::new().create(true).append(true).open(&path).map_err(fail)?;
        file.set_len(whole as u64).map_err(fail)?;
        Ok(Self { path, known, file: Mutex::new(file) })
    }

    /// The outcome of a pair, if it is known.
    pub(crate) fn get(&self, key: &Key) -> Option<Option<TwoViewGeometry>> {
        let payload = self.known.get(key.as_bytes())?;
        Some(read_two_view_geometries(payload).ok()?.into_iter().next())
    }

    /// Keeps the outcomes of some pairs.
    pub(crate) fn append<'a>(
        &self,
        outcomes: impl Iterator<Item = (&'a Key, Option<&'a TwoViewGeometry>)>,
    ) -> Result<(), PipelineError> {
        let mut bytes = Vec::new();
        for (key, pair) in outcomes {
            let payload = write_two_view_geometries(pair.map_or(&[], std::slice::from_ref));
            let start = bytes.len();
            bytes.extend(key.as_bytes());
            bytes.extend((payload.len() as u32).to_le_bytes());
            bytes.extend(payload);
            let hash = blake3::hash(&bytes[start..]);
            bytes.extend(&hash.as_bytes()[..HASH_LEN]);
        }
        let mut file = self.file.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        file.write_all(&bytes).map_err(|e| PipelineError::io(&self.path, &e))
    }
}

fn parse_record(bytes: &[u8]) -> Option<([u8; KEY_LEN], &[u8], usize)> {
    let (head, rest) = bytes.split_at_checked(HEAD_LEN)?;
    let (key, len) = head.split_first_chunk::<KEY_LEN>()?;
    let len = u32::from_le_bytes(len.try_into().ok()?) as usize;
    let (payload, rest) = rest.split_at_checked(len)?;
    let (hash, _) = rest.split_at_checked(HASH_LEN)?;
    let right = blake3::hash(&bytes[..HEAD_LEN + len]);
    (right.as_bytes()[..HASH_LEN] == *hash).then_some((*key, payload, HEAD_LEN + len + HASH_LEN))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A record that was torn or changed on disk is forgotten with all that follow it.
    #[test]
    fn whole_records_survive_a_torn_tail() {
        let folder = std::env::temp_dir().join(format!("volery-pair-log-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        let keys: Vec<Key> = (0_u8..3).map(|i| blake3::hash(&[i])).collect();
        let log = PairLog::open(&folder).unwrap();
        for key in &keys {
            log.append(std::iter::once((key, None))).unwrap();
        }
        drop(log);
        let path = folder.join("matching").join("pairs.log");
        let len = fs::metadata(&path).unwrap().len();
        File::options().write(true).open(&path).unwrap().set_len(len - 1).unwrap();
        let log = PairLog::open(&folder).unwrap();
        let known: Vec<_> = keys.iter().map(|key| log.get(key).is_some()).collect();
        assert_eq!(known, [true, true, false]);
        log.append(std::iter::once((&keys[2], None))).unwrap();
        drop(log);
        assert!(PairLog::open(&folder).unwrap().get(&keys[2]).is_some());
        fs::remove_dir_all(&folder).unwrap();
    }
}
