//! Files that are there whole or not at all.

use std::{
    fs,
    io::{self, Write},
    path::{Path, PathBuf},
};

use crate::error::PipelineError;

/// Writes a file: a temporary one beside it takes its name.
pub(crate) fn write_atomic(path: &Path, content: &[u8]) -> Result<(), PipelineError> {
    write_parts(path, &[content])
}

/// As [`write_atomic`], the parts one after the other.
pub(crate) fn write_parts(path: &Path, parts: &[&[u8]]) -> Result<(), PipelineError> {
    // Two processes may write the same unit; each has a temporary file of its own.
    let temporary = temporary(path, std::process::id());
    let write = || {
        let mut file = fs::File::create(&temporary)?;
        parts.iter().try_for_each(|part| file.write_all(part))?;
        drop(file);
        fs::rename(&temporary, path)
    };
    write().map_err(|e| PipelineError::io(path, &e))
}

/// Removes from `folder` what processes that were killed left half written.
pub(crate) fn clear_torn(folder: &Path) -> Result<(), PipelineError> {
    let clear = || {
        for entry in fs::read_dir(folder)? {
            let path = entry?.path();
            if is_temporary(&path) {
                fs::remove_file(&path)?;
            }
        }
        Ok(())
    };
    clear().map_err(|e: io::Error| PipelineError::io(folder, &e))
}

/// `NAME.PROCESS.tmp`
fn temporary(path: &Path, process: u32) -> PathBuf {
    path.with_extension(format!("{process}.tmp"))
}

fn is_temporary(path: &Path) -> bool {
    let process = path.file_stem().map(Path::new).and_then(Path::extension);
    path.extension().is_some_and(|extension| extension == "tmp")
        && process.is_some_and(|p| p.to_str().is_some_and(|p| p.parse::<u32>().is_ok()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_killed_process_left_is_cleared_and_nothing_else() {
        let name = format!("volery-atomic-{}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).unwrap();
        let kept = ["map.json", "notes.tmp", "2026.json", "flight.7.log"];
        for name in kept {
            write_atomic(&folder.join(name), b"whole").unwrap();
        }
        fs::write(temporary(&folder.join("localization.bin"), 20_231), b"ha").unwrap();
        clear_torn(&folder).unwrap();
        assert!(kept.iter().all(|name| fs::read(folder.join(name)).unwrap() == b"whole"));
        assert_eq!(fs::read_dir(&folder).unwrap().count(), kept.len());
        fs::remove_dir_all(&folder).unwrap();
    }
}
