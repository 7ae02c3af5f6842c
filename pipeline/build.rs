//! Makes the hash of everything that decides what a stage computes: the cache keys hold it, so
//! that new code never reads what old code left.

use std::{fs, io, path::Path};

fn main() -> io::Result<()> {
    let root = Path::new("..");
    let mut hash = Fnv(0xcbf2_9ce4_8422_2325);
    for path in ["vision", "pipeline/src", "Cargo.lock"] {
        println!("cargo:rerun-if-changed=../{path}");
        add(&root.join(path), &mut hash)?;
    }
    println!("cargo:rustc-env=VOLERY_CODE_HASH={:016x}", hash.0);
    Ok(())
}

fn add(path: &Path, hash: &mut Fnv) -> io::Result<()> {
    if path.is_dir() {
        let mut entries = fs::read_dir(path)?
            .map(|entry| entry.map(|entry| entry.path()))
            .collect::<Result<Vec<_>, _>>()?;
        entries.sort();
        entries.iter().try_for_each(|entry| add(entry, hash))
    } else {
        hash.add(&fs::read(path)?);
        Ok(())
    }
}

/// FNV-1a: no dependency, and nobody attacks it here.
struct Fnv(u64);

impl Fnv {
    fn add(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
    }
}
