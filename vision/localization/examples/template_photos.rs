//! Real or rendered photos placed by comparing them with views of a mesh, from a start near the
//! truth: `template_photos MESH.ply|MAP.glb FOLDER [OFFSET_M] [DRAWN]`. The folder holds photos, `camera.json` and
//! `ground_truth.csv`, in the frame of the mesh.

use std::path::PathBuf;

use nalgebra::{Point3, Vector3, Vector6};
use volery_formats::{
    DecodeLimits, decode_image, read_camera_json, read_glb_of_textured_mesh, read_ply_of_mesh,
    read_poses_csv, write_png,
};
use volery_geometry::Rng;
use volery_localization::localize::Status;
use volery_localization::{LocalizationPrior, TemplateOptions, localize_by_template, render_score};
use volery_rendering::{DrawableMesh, VirtualCamera};

mod support;

use support::cpu_ms;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let usage = "usage: template_photos MESH.ply FOLDER [OFFSET_M] [DRAWN]";
    let (mesh, folder) = (arguments.next().ok_or(usage)?, arguments.next().ok_or(usage)?);
    let offset_m: f64 = arguments.next().map_or(Ok(0.5), |v| v.parse())?;
    let drawn = arguments.next().map(PathBuf::from);
    let folder = PathBuf::from(folder);
    let bytes = std::fs::read(&mesh)?;
    let mesh = if mesh.ends_with(".glb") {
        DrawableMesh::with_texture(&read_glb_of_textured_mesh(&bytes)?)?
    } else {
        DrawableMesh::new(&read_ply_of_mesh(&bytes)?)?
    };
    println!("{} triangles", mesh.num_triangles());
    let camera = read_camera_json(&std::fs::read(folder.join("camera.json"))?)?;
    let truths = read_poses_csv(&std::fs::read(folder.join("ground_truth.csv"))?)?;
    let mut rng = Rng::new(11);
    let (mut num_ok, mut num_good, mut num_false) = (0, 0, 0);
    let (mut times, mut squared_errors, mut distances) = (Vec::new(), Vec::new(), Vec::new());
    for truth in &truths {
        let path = folder.join(&truth.image);
        let photo = decode_image(&std::fs::read(&path)?, &DecodeLimits::default())?.gray;
        let position = Point3::from(truth.world_from_cam.translation.vector);
        let direction = rng.normal3().normalize();
        let offset = if offset_m > 0.6 {
            Vector3::new(direction.x, direction.y, 0.0).normalize() * offset_m
        } else {
            direction * (offset_m * rng.uniform().cbrt())
        };
        let forward = truth.world_from_cam.rotation * Vector3::z();
        let yaw = forward.y.atan2(forward.x) + 2_f64.to_radians() * rng.normal();
        let prior = LocalizationPrior {
            position: Some((position + offset, 0.3)),
            yaw: Some((yaw, 2_f64.to_radians())),
        };
        let own = render_score(&photo, &camera, &mesh, &truth.world_from_cam.inverse());
        let start = cpu_ms();
        let answer =
            localize_by_template(&photo, &camera, &mesh, &prior, &TemplateOptions::default());
        times.push(cpu_ms() - start);
        let text = match &answer.status {
            Status::Ok(pose) => {
                let error = pose.map_from_camera.inverse() * truth.world_from_cam;
                let distance = (pose.map_from_camera.translation.vector - position.coords).norm();
                let angle = error.rotation.angle().to_degrees();
                let shift = pose.map_from_camera.translation.vector - position.coords;
                let turn = pose.map_from_camera.rotation * truth.world_from_cam.rotation.inverse();
                let turn = turn.scaled_axis();
                let off = Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z);
                let inverse = pose.covariance.try_inverse().unwrap_or_default();
                squared_errors.push(off.dot(&(inverse * off)));
                distances.push(distance);
                num_ok += 1;
                num_good += usize::from(distance < 0.05 && angle < 1.0);
                num_false += usize::from(distance > 0.3 || angle > 3.0);
                format!("ok {:.1} cm {angle:.2} deg", distance * 100.0)
            }
            Status::Ambiguous(_) => "ambiguous".to_owned(),
            Status::NotFound(reason) => reason.code().to_owned(),
        };
        let part = |score: Option<volery_localization::RenderScore>| {
            score.map_or_else(String::new, |s| {
                format!("{:.2} of {}, corr {:.2}", s.agreement, s.num_patches, s.correlation)
            })
        };
        let found = part(answer.proof.map(|proof| proof.score));
        println!("{}: {text}; found {found}; at truth {}", truth.image, part(own));
        if let Some(drawn) = &drawn {
            let view =
                VirtualCamera::new(&camera).draw_mesh(&mesh, &truth.world_from_cam.inverse());
            let png = write_png(view.width, view.height, &view.colors)?;
            std::fs::write(drawn.join(&truth.image).with_extension("png"), png)?;
        }
    }
    let num_within = squared_errors.iter().filter(|&&squared| squared < 12.59).count();
    println!("{num_within} of {num_ok} within the 95 % bound of their covariance");
    squared_errors.sort_by(f64::total_cmp);
    distances.sort_by(f64::total_cmp);
    let quantile = |sorted: &[f64], part: f64| {
        sorted.get((part * sorted.len() as f64) as usize).copied().unwrap_or(f64::NAN)
    };
    println!(
        "normalized squared error / 6: median {:.2}, 90 % {:.2}; distance: median {:.2} cm, 90 % {:.2}",
        quantile(&squared_errors, 0.5) / 6.0,
        quantile(&squared_errors, 0.9) / 6.0,
        quantile(&distances, 0.5) * 100.0,
        quantile(&distances, 0.9) * 100.0,
    );
    times.sort_by(f64::total_cmp);
    println!(
        "{num_ok} ok, {num_good} within 5 cm and 1 degree, {num_false} false, of {}; median {:.0} CPU ms",
        truths.len(),
        times[times.len() / 2]
    );
    Ok(())
}
