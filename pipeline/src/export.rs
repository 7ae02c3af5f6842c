//! Last stage: the files of a map folder.

use std::{collections::BTreeMap, fs, path::Path};

use volery_formats::{
    NamedPose, colmap::write_colmap_text, write_glb, write_ply_of_model, write_poses_csv,
    write_transforms_json,
};
use volery_localization::LocalizationIndex;
use volery_scene::{
    Descriptor, EnvironmentMap, NoProgress, Progress, RegisteredImage, SparseModel, Stage,
};

use crate::{
    atomic::{clear_torn, write_atomic},
    error::{PipelineError, code},
    heading::NorthInMap,
    ingest::Ingested,
    map_folder::{MAP_FORMAT, MapInfo, MapInput, file},
    spec::JobSpec,
};

/// Writes every file of the sparse map and of its zones but the reports; `map.json` last, since its presence says
/// that the others are whole.
pub(crate) fn write_map(
    spec: &JobSpec,
    ingested: &Ingested,
    map: &EnvironmentMap,
    out_dir: &Path,
    progress: &dyn Progress,
) -> Result<MapInfo, PipelineError> {
    // What an earlier run left is of another map; the marker goes first.
    for name in [file::MAP, file::DENSE, file::FREE_SPACE, file::MESH] {
        let path = out_dir.join(name);
        if path.exists() {
            fs::remove_file(&path).map_err(|e| PipelineError::io(&path, &e))?;
        }
    }
    let zones = out_dir.join(file::ZONES);
    if zones.exists() {
        fs::remove_dir_all(&zones).map_err(|e| PipelineError::io(&zones, &e))?;
    }
    for (i, zone) in map.zones.iter().enumerate() {
        write_sparse(spec, ingested, zone, &zones.join((i + 1).to_string()), &NoProgress)?;
    }
    write_sparse(spec, ingested, map, out_dir, progress)
}

fn write_sparse(
    spec: &JobSpec,
    ingested: &Ingested,
    map: &EnvironmentMap,
    out_dir: &Path,
    progress: &dyn Progress,
) -> Result<MapInfo, PipelineError> {
    let info = map_info(spec, ingested, map);
    let index = localization_index(ingested, &map.model).to_bytes();
    write_files(map, &info, &index, out_dir, progress)?;
    Ok(info)
}

/// Writes the files of a map from its parts.
pub(crate) fn write_files(
    map: &EnvironmentMap,
    info: &MapInfo,
    index: &[u8],
    out_dir: &Path,
    progress: &dyn Progress,
) -> Result<(), PipelineError> {
    const NUM_FILES: usize = 9;
    let colmap_dir = out_dir.join(file::COLMAP);
    fs::create_dir_all(&colmap_dir).map_err(|e| PipelineError::io(&colmap_dir, &e))?;
    clear_torn(out_dir)?;
    clear_torn(&colmap_dir)?;
    let mut done = 0;
    let mut write = |path: &Path, content: &[u8]| {
        progress.check()?;
        write_atomic(path, content)?;
        done += 1;
        progress.report(Stage::Export, done, NUM_FILES);
        Ok::<(), PipelineError>(())
    };
    let model = &map.model;
    write(
        &out_dir.join(file::POSES),
        write_poses_csv(&named_poses(model, &info.inputs)).as_bytes(),
    )?;
    let colmap = write_colmap_text(model);
    write(&colmap_dir.join("cameras.txt"), &colmap.cameras)?;
    write(&colmap_dir.join("images.txt"), &colmap.images)?;
    write(&colmap_dir.join("points3D.txt"), &colmap.points)?;
    write(&out_dir.join(file::SPARSE), &write_ply_of_model(model))?;
    write(&out_dir.join(file::GLB), &write_glb(map, &info.content_id()))?;
    write(&out_dir.join(file::TRANSFORMS), write_transforms_json(model, "images").as_bytes())?;
    write(&out_dir.join(file::LOCALIZATION), index)?;
    write(&out_dir.join(file::MAP), &info_json(info)?)
}

/// Writes `map.json` anew.
pub(crate) fn write_info(info: &MapInfo, out_dir: &Path) -> Result<(), PipelineError> {
    write_atomic(&out_dir.join(file::MAP), &info_json(info)?)
}

fn info_json(info: &MapInfo) -> Result<Vec<u8>, PipelineError> {
    serde_json::to_vec_pretty(info).map_err(|e| PipelineError::plain(code::IO, e.to_string()))
}

/// Poses in the order of the inputs; a photo that repeats another one has its pose.
fn named_poses(model: &SparseModel, inputs: &[MapInput]) -> Vec<NamedPose> {
    let by_name: BTreeMap<&str, &RegisteredImage> =
        model.images.values().map(|image| (image.name.as_str(), image)).collect();
    let by_hash: BTreeMap<&str, &RegisteredImage> = inputs
        .iter()
        .filter_map(|input| Some((input.blake3.as_str(), *by_name.get(input.name.as_str())?)))
        .collect();
    inputs
        .iter()
        .filter_map(|input| {
            let image = by_hash.get(input.blake3.as_str())?;
            let world_from_cam = image.cam_from_world.inverse();
            Some(NamedPose { image: input.name.clone(), world_from_cam })
        })
        .collect()
}

fn localization_index(ingested: &Ingested, model: &SparseModel) -> LocalizationIndex {
    let photos = model.images.keys().map(|id| &ingested.usable[id.0 as usize].photo);
    let descriptors: Vec<Vec<Descriptor>> =
        photos.clone().map(|photo| photo.features.descriptors.clone()).collect();
    let globals: Vec<_> = photos.map(|photo| photo.global.clone()).collect();
    LocalizationIndex::new(model, &descriptors, &globals)
}

fn map_info(spec: &JobSpec, ingested: &Ingested, map: &EnvironmentMap) -> MapInfo {
    let inputs = spec.images.iter().zip(&ingested.hashes).filter_map(|(image, hash)| {
        Some(MapInput { name: image.name.clone(), blake3: hash.as_ref()?.to_hex().to_string() })
    });
    let priors: Vec<_> =
        ingested.usable.iter().map(|photo| spec.images[photo.input].prior).collect();
    MapInfo {
        format: MAP_FORMAT,
        software: concat!("volery ", env!("CARGO_PKG_VERSION")).to_owned(),
        scale: map.scale,
        gravity: map.gravity,
        origin: map.origin,
        quality: map.quality.clone(),
        cameras: map.model.cameras.values().map(Into::into).collect(),
        num_images: map.model.images.len(),
        num_points: map.model.points.len(),
        num_dense_points: None,
        free_space_voxel: None,
        num_triangles: None,
        bounds: bounds(&map.model),
        north: NorthInMap::estimate(&map.model, &priors),
        map_from_index: None,
        seed: spec.seed,
        inputs: inputs.collect(),
    }
}

/// Box around the points without the outermost hundredth on every side.
pub(crate) fn bounds(model: &SparseModel) -> Option<[[f64; 3]; 2]> {
    let (mut low, mut high) = ([0.0; 3], [0.0; 3]);
    for (axis, (low, high)) in low.iter_mut().zip(&mut high).enumerate() {
        let mut values: Vec<f64> = model.points.values().map(|p| p.position[axis]).collect();
        values.sort_by(f64::total_cmp);
        let cut = values.len() / 100;
        *low = *values.get(cut)?;
        *high = values[values.len() - 1 - cut];
    }
    Some([low, high])
}
