//! CPU time of feature extraction and matching, and the features themselves for other programs.
//!
//! `features [-o FOLDER] IMAGE.pgm...` prints one line per image and one per neighboring pair. With
//! `-o`, writes `FOLDER/NAME.kp` (f32 x, y, scale, orientation), `NAME.desc` (128 bytes each),
//! `NAME.vlad` (f32) and `NAME1-NAME2.match` (u32 pairs) for neighbors, little endian.

use std::path::{Path, PathBuf};

use volery_features::{
    MatchOptions, PackedDescriptors, SiftOptions, detect_and_describe, global_descriptor,
    match_features,
};
use volery_scene::GrayImage;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let mut folder = None;
    if arguments.first().is_some_and(|a| a == "-o") && arguments.len() > 1 {
        folder = Some(PathBuf::from(&arguments[1]));
        arguments.drain(..2);
    }
    let mut previous: Option<(String, PackedDescriptors)> = None;
    for path in arguments.iter().map(Path::new) {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let image = read_pgm(path)?;
        let start = cpu_ms()?;
        let features = detect_and_describe(&image, &SiftOptions::default());
        let extracted = cpu_ms()?;
        let global = global_descriptor(&features);
        let described = cpu_ms()?;
        let packed = PackedDescriptors::new(&features.descriptors);
        println!(
            "{name}: {}x{}, {} features, sift {:.1} ms, global {:.2} ms, pack {:.2} ms",
            image.width(),
            image.height(),
            features.len(),
            extracted - start,
            described - extracted,
            cpu_ms()? - described,
        );
        let matches = match &previous {
            None => Vec::new(),
            Some((before, other)) => {
                let start = cpu_ms()?;
                let matches = match_features(other, &packed, &MatchOptions::default());
                println!(
                    "{before}-{name}: {} x {}, {} matches, {:.1} ms",
                    other.len(),
                    packed.len(),
                    matches.len(),
                    cpu_ms()? - start
                );
                matches
            }
        };
        if let Some(folder) = &folder {
            let keypoints = features
                .keypoints
                .iter()
                .flat_map(|k| [k.x, k.y, k.scale, k.orientation])
                .flat_map(f32::to_le_bytes);
            std::fs::write(folder.join(format!("{name}.kp")), keypoints.collect::<Vec<u8>>())?;
            std::fs::write(folder.join(format!("{name}.desc")), features.descriptors.concat())?;
            let global: Vec<u8> = global.0.iter().flat_map(|v| v.to_le_bytes()).collect();
            std::fs::write(folder.join(format!("{name}.vlad")), global)?;
            if let Some((before, _)) = &previous {
                let bytes: Vec<u8> = matches
                    .iter()
                    .flat_map(|m| [m.feature1, m.feature2])
                    .flat_map(u32::to_le_bytes)
                    .collect();
                std::fs::write(folder.join(format!("{before}-{name}.match")), bytes)?;
            }
        }
        previous = Some((name, packed));
    }
    Ok(())
}

/// CPU time of this thread (Linux).
fn cpu_ms() -> Result<f64, Failure> {
    let stat = std::fs::read_to_string("/proc/thread-self/schedstat")?;
    let nanoseconds: f64 = stat.split_whitespace().next().ok_or("empty schedstat")?.parse()?;
    Ok(nanoseconds * 1e-6)
}

/// Binary PGM (P5) without comments.
fn read_pgm(path: &Path) -> Result<GrayImage, Failure> {
    let bytes = std::fs::read(path)?;
    let mut position = 0;
    let mut word = || {
        let start = position;
        while bytes.get(position).is_some_and(|b| !b.is_ascii_whitespace()) {
            position += 1;
        }
        position += 1;
        bytes.get(start..position - 1).and_then(|w| std::str::from_utf8(w).ok()).unwrap_or("")
    };
    if word() != "P5" {
        return Err("not a binary PGM".into());
    }
    let (width, height, _) = (word().parse()?, word().parse()?, word().parse::<u32>()?);
    let pixels = bytes.get(position..).ok_or("truncated PGM")?.to_vec();
    Ok(GrayImage::new(width, height, pixels).ok_or("wrong size of PGM")?)
}
