//! Puts the built page of the ground station (`web/dist`) into the library, packed ahead of time.

use std::{
    env,
    error::Error,
    fmt::Write as _,
    fs,
    hash::{DefaultHasher, Hash, Hasher},
    io::Write as _,
    path::Path,
};

use flate2::{Compression, write::GzEncoder};

fn main() -> Result<(), Box<dyn Error>> {
    let dist = Path::new(&env::var("CARGO_MANIFEST_DIR")?).join("../web/dist").canonicalize()?;
    let out = env::var("OUT_DIR")?;
    println!("cargo:rerun-if-changed={}", dist.display());
    let mut table = "&[\n".to_owned();
    for (number, name) in names(&dist)?.iter().enumerate() {
        let path = dist.join(name);
        let bytes = fs::read(&path)?;
        let packed = Path::new(&out).join(format!("{number}.gz"));
        let mut gzip = GzEncoder::new(fs::File::create(&packed)?, Compression::best());
        gzip.write_all(&bytes)?;
        gzip.finish()?;
        let mut hasher = DefaultHasher::new();
        bytes.hash(&mut hasher);
        let tag = format!("{:016x}", hasher.finish());
        writeln!(
            table,
            "    File {{ name: {name:?}, tag: {tag:?}, plain: include_bytes!({path:?}), \
             gzip: include_bytes!({packed:?}) }},"
        )?;
    }
    table.push(']');
    fs::write(Path::new(&out).join("page_files.rs"), table)?;
    Ok(())
}

/// Files of the page relative to its folder, in order.
fn names(dist: &Path) -> Result<Vec<String>, Box<dyn Error>> {
    let mut names = Vec::new();
    for folder in ["", "assets"] {
        for entry in fs::read_dir(dist.join(folder))? {
            let entry = entry?;
            if entry.file_type()?.is_file() {
                let name = entry.file_name().into_string().map_err(|_| "a name is not UTF-8")?;
                names.push(Path::new(folder).join(name).display().to_string());
            }
        }
    }
    names.sort();
    Ok(names)
}
