//! Photos of a furnished hall placed by comparing them with views of its mesh:
//! `template_hall EDGE_M NUM [GAIN GAMMA]`.

use nalgebra::{Point3, Vector3};
use volery_geometry::triangulation::camera_center;
use volery_geometry::{Camera, CameraModel, Rng};
use volery_localization::localize::Status;
use volery_localization::{LocalizationPrior, TemplateOptions, localize_by_template};
use volery_rendering::DrawableMesh;
use volery_scene::GrayImage;
use volery_synthetic::{Hall, Renderer, Sensor, cam_from_heading};

mod support;

use support::cpu_ms;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let numbers: Vec<f64> = std::env::args().skip(1).filter_map(|v| v.parse().ok()).collect();
    let edge = numbers.first().copied().unwrap_or(0.06);
    let num = numbers.get(1).copied().unwrap_or(40.0) as usize;
    let gain = numbers.get(2).copied().unwrap_or(1.0);
    let gamma = numbers.get(3).copied().unwrap_or(1.0);
    let wrong = numbers.get(4).copied().unwrap_or(0.0);
    let hall = Hall::furnished(Vector3::new(10.0, 8.0, 3.8), 0.01, 7);
    let mesh = DrawableMesh::new(&hall.mesh(edge))?;
    println!("{} triangles", mesh.num_triangles());
    let camera = Camera::from_focal(CameraModel::Pinhole, 640, 480, 457.0)?;
    let renderer = Renderer::new(&camera);
    let mut rng = Rng::new(3);
    let mut truths = Vec::new();
    while truths.len() < num {
        let place = Point3::new(rng.range(-5.0, 5.0), rng.range(-4.0, 4.0), rng.range(0.8, 2.6));
        let yaw = rng.range(0.0, std::f64::consts::TAU);
        let tilt = [0; 2].map(|_| 0.5f64.to_radians() * rng.normal());
        if hall.room.is_free(&place, 0.8) {
            truths.push(cam_from_heading(&place, yaw, tilt[0], tilt[1]));
        }
    }
    let mut nees = Vec::new();
    let (mut good, mut fine, mut found, mut times) = (0, 0, 0, Vec::new());
    for (number, truth) in truths.iter().enumerate() {
        let photo = Sensor::default().expose(&renderer.render(&hall, truth), number as u64).gray();
        let lit = |v: &u8| (255.0 * gain * (f64::from(*v) / 255.0).powf(gamma)).min(255.0) as u8;
        let photo = GrayImage::new(640, 480, photo.pixels().iter().map(lit).collect()).unwrap();
        let mut offset = rng.normal3();
        offset *= 0.5 * rng.uniform().cbrt() / offset.norm();
        if wrong > 0.0 {
            offset = offset.normalize() * wrong;
            offset.z *= 0.1;
        }
        let forward = truth.rotation.inverse() * Vector3::z();
        let yaw = forward.y.atan2(forward.x) + 2f64.to_radians() * rng.normal();
        let prior = LocalizationPrior {
            position: Some((Point3::from(camera_center(truth) + offset), 0.3)),
            yaw: Some((yaw, 2f64.to_radians())),
        };
        let start = cpu_ms();
        let answer =
            localize_by_template(&photo, &camera, &mesh, &prior, &TemplateOptions::default());
        let elapsed = cpu_ms() - start;
        times.push(elapsed);
        let score = answer.proof.map(|p| p.score);
        let text = score.map_or(String::new(), |s| {
            format!("corr {:.2} agree {:.2} patches {}", s.correlation, s.agreement, s.num_patches)
        });
        match &answer.status {
            Status::Ok(pose) => {
                let error =
                    (camera_center(truth).coords - pose.map_from_camera.translation.vector).norm();
                let turn = (pose.map_from_camera.rotation * truth.rotation).angle().to_degrees();
                found += 1;
                good += usize::from(error < 0.05 && turn < 1.0);
                fine += usize::from(error < 0.02 && turn < 0.5);
                let off = pose.map_from_camera.translation.vector - camera_center(truth).coords;
                let spin = (pose.map_from_camera.rotation * truth.rotation).scaled_axis();
                let off = nalgebra::Vector6::new(off.x, off.y, off.z, spin.x, spin.y, spin.z);
                if let Some(chol) = pose.covariance.cholesky() {
                    nees.push(off.dot(&chol.solve(&off)) / 6.0);
                }
                let sigma = pose.covariance.fixed_view::<3, 3>(0, 0).trace().sqrt();
                println!(
                    "{number}: {:.1} cm {turn:.2} deg (sigma {:.1} cm), {} inliers {:.2}, {text}, {elapsed:.0} ms, {} places",
                    100.0 * error,
                    100.0 * sigma,
                    pose.num_inliers,
                    pose.inlier_ratio(),
                    answer.num_places
                );
            }
            Status::Ambiguous(_) => println!("{number}: ambiguous {text} {elapsed:.0} ms"),
            Status::NotFound(reason) => {
                println!("{number}: {} {text} {elapsed:.0} ms", reason.code())
            }
        }
    }
    nees.sort_by(f64::total_cmp);
    if !nees.is_empty() {
        println!(
            "NEES / 6: median {:.1}, 90 % {:.1}",
            nees[nees.len() / 2],
            nees[nees.len() * 9 / 10]
        );
    }
    times.sort_by(f64::total_cmp);
    println!(
        "found {found}, 5 cm 1 deg: {good}, 2 cm 0.5 deg: {fine} of {num}; median {:.0} CPU ms, fastest {:.0}, slowest {:.0}",
        times[num / 2],
        times[0],
        times[num - 1]
    );
    Ok(())
}
