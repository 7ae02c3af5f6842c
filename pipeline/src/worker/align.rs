//! A map folder in another frame.

use std::{collections::BTreeMap, fs, path::Path};

use nalgebra::{Point2, Point3, Similarity3, Vector3};
use serde_json::{Value, json};
use volery_api::{AlignRequest, ControlPoint, Sim3};
use volery_formats::{
    move_glb, read_occupancy, read_ply_of_cloud, read_ply_of_mesh, write_occupancy,
    write_ply_of_cloud, write_ply_of_mesh,
};
use volery_geometry::{similarity_from_points, triangulation::triangulate_linear};
use volery_scene::{
    EnvironmentMap, Gravity, GravitySource, NoProgress, OriginRule, RegisteredImage, Scale,
    ScaleSource, SparseModel,
};

use crate::{
    PipelineError,
    atomic::write_atomic,
    error::code,
    export::{bounds, write_files},
    map_folder::{MapInfo, file, read_map},
    moved::{self, MovedBy},
    wire,
};

/// Error of a length measured by hand between two camera centers, meters.
const DISTANCE_SIGMA: f64 = 0.01;

/// What rounding leaves of no change.
const SAME: f64 = 1e-9;

/// Writes the map of `map_dir`, moved as asked, to `out_dir`; returns the residuals.
pub(crate) fn align_folder(
    map_dir: &Path,
    out_dir: &Path,
    align: &AlignRequest,
) -> Result<Value, PipelineError> {
    let (mut info, mut map) = read_map(map_dir)?;
    let path = map_dir.join(file::LOCALIZATION);
    let index = fs::read(&path).map_err(|e| PipelineError::io(&path, &e))?;
    let (new_from_map, residuals) = similarity(align, &mut map)?;
    map.model.transform(&new_from_map);
    let map_from_index =
        info.map_from_index.map_or(Similarity3::identity(), |moved| moved.similarity());
    info.map_from_index = Some(MovedBy::from(&(new_from_map * map_from_index)));
    info.north = info.north.and_then(|north| moved::turn_north(&north, &new_from_map));
    info.scale = map.scale;
    info.gravity = map.gravity;
    info.origin = map.origin;
    info.bounds = bounds(&map.model);
    info.free_space_voxel = info.free_space_voxel.map(|voxel| voxel * new_from_map.scaling());
    write_files(&map, &info, &index, out_dir, &NoProgress)?;
    move_surface(map_dir, out_dir, &info, &new_from_map)?;
    move_report(map_dir, out_dir, &info)?;
    Ok(residuals)
}

/// What is known of the photos, with the frame as it is now. The page of the report shows the map
/// as it was: it stays there.
fn move_report(map_dir: &Path, out_dir: &Path, info: &MapInfo) -> Result<(), PipelineError> {
    let path = map_dir.join(file::REPORT);
    if !path.exists() {
        return Ok(());
    }
    let json_error = |e: serde_json::Error| PipelineError::plain(code::BAD_MAP, e.to_string());
    let bytes = fs::read(&path).map_err(|e| PipelineError::io(&path, &e))?;
    let mut report: Value = serde_json::from_slice(&bytes).map_err(json_error)?;
    let frame = json!({ "scale": info.scale, "gravity": info.gravity, "origin": info.origin });
    for (key, value) in frame.as_object().into_iter().flatten() {
        if let Some(stale) = report.get_mut(key) {
            *stale = value.clone();
        }
    }
    let bytes = serde_json::to_vec_pretty(&report).map_err(json_error)?;
    write_atomic(&out_dir.join(file::REPORT), &bytes)
}

/// Dense cloud, free space and mesh, as far as the map has them.
fn move_surface(
    map_dir: &Path,
    out_dir: &Path,
    info: &MapInfo,
    new_from_map: &Similarity3<f64>,
) -> Result<(), PipelineError> {
    let read = |name: &str| {
        let path = map_dir.join(name);
        fs::read(&path).map_err(|e| PipelineError::io(&path, &e))
    };
    let write = |name: &str, bytes: &[u8]| write_atomic(&out_dir.join(name), bytes);
    let bad = |name: &str, error: &dyn std::fmt::Display| {
        PipelineError::plain(code::BAD_MAP, format!("{name}: {error}"))
    };
    if info.num_dense_points.is_some() {
        let mut cloud = read_ply_of_cloud(&read(file::DENSE)?).map_err(|e| bad(file::DENSE, &e))?;
        let rotation = new_from_map.isometry.rotation.cast::<f32>();
        for point in &mut cloud.points {
            point.position = (new_from_map * point.position.cast::<f64>()).cast();
            point.normal = rotation * point.normal;
        }
        write(file::DENSE, &write_ply_of_cloud(&cloud))?;
    }
    if info.free_space_voxel.is_some() {
        let grid =
            read_occupancy(&read(file::FREE_SPACE)?).map_err(|e| bad(file::FREE_SPACE, &e))?;
        let moved = grid.moved(new_from_map).ok_or_else(|| degenerate("the scale is absurd"))?;
        write(file::FREE_SPACE, &write_occupancy(&moved))?;
    }
    if info.num_triangles.is_some() {
        let mut mesh = read_ply_of_mesh(&read(file::MESH)?).map_err(|e| bad(file::MESH, &e))?;
        mesh.vertices.iter_mut().for_each(|vertex| *vertex = new_from_map * *vertex);
        write(file::MESH, &write_ply_of_mesh(&mesh))?;
        let glb = move_glb(&read(file::GLB)?, new_from_map).map_err(|e| bad(file::GLB, &e))?;
        write(file::GLB, &glb)?;
    }
    Ok(())
}

/// The similarity that is asked for; scale, gravity and origin of `map` take their new proof.
fn similarity(
    align: &AlignRequest,
    map: &mut EnvironmentMap,
) -> Result<(Similarity3<f64>, Value), PipelineError> {
    match align {
        AlignRequest::KnownDistance(distance) => {
            let a = center(&map.model, &distance.image_a)?;
            let b = center(&map.model, &distance.image_b)?;
            let length = (a - b).norm();
            if !(length > 0.0 && distance.meters.is_finite() && distance.meters > 0.0) {
                return Err(degenerate("the two cameras are at the same place"));
            }
            map.scale = Scale {
                metric: true,
                source: ScaleSource::KnownDistance,
                sigma_rel: Some(DISTANCE_SIGMA / distance.meters),
            };
            let scale = distance.meters / length;
            Ok((
                Similarity3::from_scaling(scale),
                json!({ "scale": scale, "length_before": length }),
            ))
        }
        AlignRequest::Sim3(sim3) => {
            if let Some(problem) = sim3.problem() {
                return Err(degenerate(&problem));
            }
            let pose = wire::isometry(&sim3.translation, &sim3.rotation);
            map.scale = scale_by_hand(sim3, map.scale);
            if (pose.rotation * Vector3::z() - Vector3::z()).norm() > SAME {
                map.gravity = Gravity { source: GravitySource::Given, sigma: None };
            }
            if pose.translation.vector.norm() > SAME {
                map.origin = OriginRule::Given;
            }
            Ok((Similarity3::from_isometry(pose, sim3.scale), json!({})))
        }
        AlignRequest::ControlPoints(points) => control_points(points, map),
    }
}

/// Moves and turns leave the proof of the scale; another scale has none but what comes with it.
fn scale_by_hand(sim3: &Sim3, before: Scale) -> Scale {
    let is_kept = (sim3.scale - 1.0).abs() < SAME && sim3.sigma_rel.is_none();
    match sim3.metric {
        false => Scale { metric: false, source: ScaleSource::Unknown, sigma_rel: None },
        true if before.metric && is_kept => before,
        true => Scale { metric: true, source: ScaleSource::Given, sigma_rel: sim3.sigma_rel },
    }
}

fn control_points(
    points: &[ControlPoint],
    map: &mut EnvironmentMap,
) -> Result<(Similarity3<f64>, Value), PipelineError> {
    let by_name: BTreeMap<&str, &RegisteredImage> =
        map.model.images.values().map(|image| (image.name.as_str(), image)).collect();
    let (mut source, mut target) = (Vec::new(), Vec::new());
    for point in points {
        let (mut poses, mut rays) = (Vec::new(), Vec::new());
        for sighting in &point.observations {
            let image = by_name.get(sighting.image.as_str()).ok_or_else(|| {
                PipelineError::plain(
                    "unknown_image",
                    format!("image {:?} has no pose in the map", sighting.image),
                )
            })?;
            let camera = &map.model.cameras[&image.camera];
            let ray = camera.unproject(&Point2::from(sighting.pixel));
            rays.push(ray.ok_or_else(|| degenerate("a pixel has no ray"))?);
            poses.push(image.cam_from_world);
        }
        let position = (poses.len() >= 2).then(|| triangulate_linear(&poses, &rays)).flatten();
        source.push(position.ok_or_else(|| {
            degenerate("a control point needs two sightings from different places")
        })?);
        target.push(Point3::from(point.position));
    }
    let new_from_map =
        similarity_from_points(&source, &target).map_err(|e| degenerate(&e.to_string()))?;
    let residuals: Vec<f64> =
        source.iter().zip(&target).map(|(s, t)| (new_from_map * s - t).norm()).collect();
    let n = residuals.len() as f64;
    let rms = (residuals.iter().map(|r| r * r).sum::<f64>() / n).sqrt();
    let mean = target.iter().map(|p| p.coords).sum::<Vector3<f64>>() / n;
    let extent = (target.iter().map(|p| (p.coords - mean).norm_squared()).sum::<f64>() / n).sqrt();
    let sigma = rms.max(1e-3) / extent;
    map.scale = Scale {
        metric: true,
        source: ScaleSource::ControlPoints,
        sigma_rel: Some(sigma / n.sqrt()),
    };
    map.gravity = Gravity { source: GravitySource::ControlPoints, sigma: Some(sigma) };
    map.origin = OriginRule::Given;
    Ok((new_from_map, json!({ "rms_m": rms, "residuals_m": residuals })))
}

fn center(model: &SparseModel, name: &str) -> Result<Point3<f64>, PipelineError> {
    let image = model.images.values().find(|image| image.name == name);
    image.map(RegisteredImage::center).ok_or_else(|| {
        PipelineError::plain("unknown_image", format!("image {name:?} has no pose in the map"))
    })
}

fn degenerate(detail: &str) -> PipelineError {
    PipelineError::plain("degenerate", detail)
}

#[cfg(test)]
mod tests;
