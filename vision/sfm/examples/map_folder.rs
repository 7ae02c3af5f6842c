//! Maps a folder of photos and writes the poses: `map_folder PHOTOS OUT.csv [options]`.
//!
//! * `--camera FILE`: known intrinsics (`camera.json`), held fixed; `--refine` lets them move.
//! * `--no-exif`: every focal length is a guess; `--per-image`: a camera for every image.
//! * `--sequential N`: match only the N next images of each.
//! * `--mapper global`: run the global mapper alone.
//! * `--min-angle DEGREES`: least triangulation angle of a point.
//! * `--features N`: most features per image.
//! * `--cache DIR`: keep features and pairs between runs.
//!
//! Prints seconds of CPU per stage and the figures of the map.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use rayon::prelude::*;
use volery_estimation::{IntrinsicsRefinement, TwoViewOptions, estimate_two_view_geometry};
use volery_features::{
    MatchOptions, PackedDescriptors, SiftOptions, detect_and_describe, match_features,
};
use volery_formats::{
    DecodeLimits, NamedPose, decode_image, read_camera_json, read_exif, read_features,
    read_two_view_geometries, write_features, write_poses_csv, write_two_view_geometries,
};
use volery_geometry::{Camera, CameraModel};
use volery_scene::{CameraId, Features, NoProgress, Quality, TwoViewGeometry, Verdict};
use volery_sfm::quality::Evidence;
use volery_sfm::self_calibration::start_cameras;
use volery_sfm::{MapperOptions, Reconstruction, SfmCamera, SfmImage, map_globally, reconstruct};

type Error = Box<dyn std::error::Error>;

struct Arguments {
    photos: PathBuf,
    out: PathBuf,
    camera: Option<PathBuf>,
    refine: bool,
    no_exif: bool,
    per_image: bool,
    sequential: usize,
    features: usize,
    global: bool,
    min_angle_deg: f64,
    cache: Option<PathBuf>,
}

fn arguments() -> Result<Arguments, Error> {
    let mut found = Arguments {
        photos: PathBuf::new(),
        out: PathBuf::new(),
        camera: None,
        refine: false,
        no_exif: false,
        per_image: false,
        sequential: usize::MAX,
        features: 8192,
        global: false,
        min_angle_deg: 1.5,
        cache: None,
    };
    let mut free = Vec::new();
    let mut list = std::env::args().skip(1);
    while let Some(argument) = list.next() {
        let mut value = || list.next().ok_or_else(|| format!("{argument} needs a value"));
        match argument.as_str() {
            "--camera" => found.camera = Some(value()?.into()),
            "--sequential" => found.sequential = value()?.parse()?,
            "--features" => found.features = value()?.parse()?,
            "--cache" => found.cache = Some(value()?.into()),
            "--mapper" => found.global = value()? == "global",
            "--min-angle" => found.min_angle_deg = value()?.parse()?,
            "--refine" => found.refine = true,
            "--no-exif" => found.no_exif = true,
            "--per-image" => found.per_image = true,
            _ => free.push(PathBuf::from(argument)),
        }
    }
    let [photos, out] =
        free.try_into().map_err(|_| "usage: map_folder PHOTOS OUT.csv [options]")?;
    Ok(Arguments { photos, out, ..found })
}

/// Seconds of CPU of this process so far, all threads.
fn cpu_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or("").split_whitespace().collect();
    let ticks = |i: usize| fields.get(i).and_then(|f| f.parse::<f64>().ok()).unwrap_or(0.0);
    (ticks(11) + ticks(12)) / 100.0
}

struct Photo {
    features: Features,
    colors: Vec<[u8; 3]>,
    camera: SfmCamera,
}

fn read_photo(path: &Path, arguments: &Arguments) -> Result<Photo, Error> {
    let bytes = std::fs::read(path)?;
    let decoded = decode_image(&bytes, &DecodeLimits::default())?;
    let (width, height) = (decoded.gray.width(), decoded.gray.height());
    let cached = arguments
        .cache
        .as_ref()
        .map(|cache| cache.join(path.file_name().unwrap_or_default()).with_extension("features"));
    let features = match &cached {
        Some(file) if file.exists() => read_features(&std::fs::read(file)?)?,
        _ => {
            let options =
                SiftOptions { max_features: arguments.features, ..SiftOptions::default() };
            detect_and_describe(&decoded.gray, &options)
        }
    };
    if let Some(file) = cached {
        std::fs::write(file, write_features(&features))?;
    }
    let colors = features.keypoints.iter().map(|k| decoded.rgb_at(k.x, k.y)).collect();
    let exif = read_exif(&bytes);
    let guess = exif.focal_px(width, height);
    let is_guess = arguments.no_exif || guess.source.code() == "guess";
    let focal = if arguments.no_exif { 1.2 * f64::from(width.max(height)) } else { guess.px };
    let camera = SfmCamera {
        camera: Camera::from_focal(CameraModel::SimpleRadial, width, height, focal)?,
        refine: IntrinsicsRefinement::FOCAL_AND_DISTORTION,
        focal_is_guess: is_guess,
    };
    Ok(Photo { features, colors, camera })
}

fn match_pair(
    i: usize,
    j: usize,
    images: &[SfmImage],
    cameras: &[SfmCamera],
    packed: &[PackedDescriptors],
) -> Option<TwoViewGeometry> {
    let matches = match_features(&packed[i], &packed[j], &MatchOptions::default());
    let (a, b) = (&cameras[images[i].camera.0 as usize], &cameras[images[j].camera.0 as usize]);
    let options = TwoViewOptions {
        calibrated: !a.focal_is_guess && !b.focal_is_guess,
        ..TwoViewOptions::default()
    };
    estimate_two_view_geometry(
        images[i].id,
        &a.camera,
        &images[i].keypoints,
        images[j].id,
        &b.camera,
        &images[j].keypoints,
        &matches,
        &options,
        (i * 10_007 + j) as u64,
    )
}

fn main() -> Result<(), Error> {
    let arguments = arguments()?;
    if let Some(cache) = &arguments.cache {
        std::fs::create_dir_all(cache)?;
    }
    let mut paths: Vec<PathBuf> = std::fs::read_dir(&arguments.photos)?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| {
            let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
            ["jpg", "jpeg", "png"].iter().any(|known| extension == *known)
        })
        .collect();
    paths.sort();
    let photos = paths
        .par_iter()
        .map(|path| read_photo(path, &arguments).map_err(|e| format!("{}: {e}", path.display())))
        .collect::<Result<Vec<_>, _>>()?;
    let features_s = cpu_s();

    let mut cameras: Vec<SfmCamera> = if arguments.per_image {
        photos.iter().map(|photo| photo.camera).collect()
    } else {
        vec![photos[0].camera]
    };
    if let Some(file) = &arguments.camera {
        let camera = read_camera_json(&std::fs::read(file)?)?;
        let refine = if arguments.refine {
            IntrinsicsRefinement::FOCAL_AND_DISTORTION
        } else {
            IntrinsicsRefinement::FIXED
        };
        cameras = vec![SfmCamera { camera, refine, focal_is_guess: false }];
    }
    let images: Vec<SfmImage> = paths
        .iter()
        .zip(&photos)
        .enumerate()
        .map(|(index, (path, photo))| SfmImage {
            name: path.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            camera: CameraId(if cameras.len() > 1 { index as u32 } else { 0 }),
            colors: photo.colors.clone(),
            ..SfmImage::from_features(index, Arc::new(photo.features.clone()))
        })
        .collect();

    let kind = format!(
        "pairs-{}-{}-{}.bin",
        arguments.sequential.min(99_999),
        cameras.len(),
        if cameras[0].focal_is_guess { "guess" } else { "focal" }
    );
    let pairs_file = arguments.cache.as_ref().map(|cache| cache.join(kind));
    let pairs: Vec<TwoViewGeometry> = match &pairs_file {
        Some(file) if file.exists() => read_two_view_geometries(&std::fs::read(file)?)?,
        _ => {
            let packed: Vec<_> = photos
                .iter()
                .map(|photo| PackedDescriptors::new(&photo.features.descriptors))
                .collect();
            let n = images.len();
            let indices: Vec<(usize, usize)> = (0..n)
                .flat_map(|i| (i + 1..n).map(move |j| (i, j)))
                .filter(|(i, j)| j - i <= arguments.sequential)
                .collect();
            indices
                .par_iter()
                .filter_map(|&(i, j)| match_pair(i, j, &images, &cameras, &packed))
                .collect()
        }
    };
    if let Some(file) = pairs_file {
        std::fs::write(file, write_two_view_geometries(&pairs))?;
    }
    let matching_s = cpu_s();

    let options = MapperOptions {
        min_angle: arguments.min_angle_deg.to_radians(),
        ..MapperOptions::default()
    };
    let found = if arguments.global {
        let start = start_cameras(&images, &cameras, &pairs);
        let models = map_globally(&images, &cameras, &start, &pairs, &options, &NoProgress)?;
        let quality = Quality { verdict: Verdict::Suspect, reasons: Vec::new() };
        Reconstruction { models, unplaced: Vec::new(), quality, mapper: "global" }
    } else {
        reconstruct(&images, &cameras, &pairs, &options, &NoProgress)?
    };
    let mapping_s = cpu_s();
    let num_keypoints: usize = images.iter().map(|image| image.keypoints.len()).sum();
    println!(
        "{} images, {} keypoints each, {} verified pairs",
        images.len(),
        num_keypoints / images.len().max(1),
        pairs.len()
    );
    println!(
        "CPU s: features {features_s:.2}, matching {:.2}, mapping {:.2}, total {mapping_s:.2}",
        matching_s - features_s,
        mapping_s - matching_s
    );
    for model in &found.models {
        println!(
            "{}: {} images, {} points, track {:.2}, {:.3} px",
            found.mapper,
            model.images.len(),
            model.points.len(),
            model.num_observations() as f64 / model.points.len().max(1) as f64,
            model.mean_reprojection_error_px().unwrap_or(0.0)
        );
        for camera in model.cameras.values().take(3) {
            println!("  {} {:.3?}", camera.model.name(), camera.params());
        }
    }
    for unplaced in &found.unplaced {
        println!("unplaced {} {}", images[unplaced.image.0 as usize].name, unplaced.reason.code());
        let own = |p: &&TwoViewGeometry| p.image1 == unplaced.image || p.image2 == unplaced.image;
        for pair in pairs.iter().filter(own) {
            println!(
                "  {:3} {:3} {:?} {} of {} matches, {:.2} degrees",
                pair.image1.0,
                pair.image2.0,
                pair.kind,
                pair.num_inliers(),
                pair.num_putative,
                pair.median_parallax.to_degrees()
            );
        }
    }
    println!("quality {:?}", found.quality);
    if let Some(model) = found.models.first() {
        println!("{:?}", Evidence::of(model, &pairs));
    }
    if let Some(model) = found.models.first() {
        let poses: Vec<NamedPose> = model
            .images
            .values()
            .map(|image| NamedPose {
                image: image.name.clone(),
                world_from_cam: image.cam_from_world.inverse(),
            })
            .collect();
        std::fs::write(&arguments.out, write_poses_csv(&poses))?;
    }
    Ok(())
}
