//! Draws a furnished hall and says what it takes: `draw EDGE_M OUT.png [MODEL]`.

use std::time::Instant;

use nalgebra::{Point3, Vector3};
use volery_formats::write_png;
use volery_geometry::{Camera, CameraModel, SimdLevel};
use volery_rendering::{DrawableMesh, DrawablePoints, VirtualCamera};
use volery_synthetic::{Hall, Renderer, cam_from_heading};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [edge, out, model @ ..] = &arguments[..] else {
        return Err("usage: draw EDGE_M OUT.png [MODEL]".into());
    };
    let model = model.first().map_or(Some(CameraModel::Pinhole), |m| CameraModel::from_name(m));
    let camera = Camera::from_focal(model.ok_or("no such model")?, 640, 480, 457.0)?;
    let hall = Hall::furnished(Vector3::new(10.0, 8.0, 3.8), 0.01, 7);
    let mesh = hall.mesh(edge.parse()?);
    let timed = |name: &str, work: &mut dyn FnMut()| {
        let mut times: Vec<f64> = (0..9)
            .map(|_| {
                let start = Instant::now();
                work();
                start.elapsed().as_secs_f64() * 1e3
            })
            .collect();
        times.sort_by(f64::total_cmp);
        println!("{name}: {:.2} ms (fastest {:.2})", times[4], times[0]);
    };
    let start = Instant::now();
    let drawable = DrawableMesh::new(&mesh)?;
    println!("{} triangles prepared in {:?}", drawable.num_triangles(), start.elapsed());
    let start = Instant::now();
    let eye = VirtualCamera::new(&camera);
    println!("camera prepared in {:?}", start.elapsed());
    let inside = cam_from_heading(&Point3::new(-1.0, -0.5, 1.6), 0.4, 0.05, 0.02);
    let outside = cam_from_heading(&Point3::new(0.0, -16.0, 3.0), 0.0, -0.05, 0.0);
    for &level in SimdLevel::available() {
        timed(&format!("inside, {level:?}"), &mut || {
            eye.draw_mesh_with(level, &drawable, &inside);
        });
        timed(&format!("all in view, {level:?}"), &mut || {
            eye.draw_mesh_with(level, &drawable, &outside);
        });
    }
    let points = DrawablePoints {
        positions: mesh.vertices.clone(),
        colors: mesh.colors.clone(),
        radius: 0.02,
    };
    timed("points", &mut || {
        eye.draw_points(&points, &inside);
    });
    let drawn = eye.draw_mesh(&drawable, &inside);
    std::fs::write(out, write_png(drawn.width, drawn.height, &drawn.colors)?)?;
    let drawn = eye.draw_points(&points, &inside);
    std::fs::write(format!("{out}.points.png"), write_png(640, 480, &drawn.colors)?)?;
    let drawn = eye.draw_mesh(&drawable, &outside);
    std::fs::write(format!("{out}.outside.png"), write_png(640, 480, &drawn.colors)?)?;
    let truth = Renderer::new(&camera).render(&hall, &inside);
    let colors: Vec<[u8; 3]> =
        truth.colors.iter().map(|c| c.map(|v| v.round().clamp(0.0, 255.0) as u8)).collect();
    std::fs::write(format!("{out}.truth.png"), write_png(640, 480, &colors)?)?;
    Ok(())
}
