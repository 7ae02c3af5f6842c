//! What a virtual camera sees of a mesh (P63).

mod support;

use nalgebra::{Point2, Point3, Vector3};
use support::{add_quad, camera, pose, seen_at};
use volery_geometry::{Camera, CameraModel, Rng, SimdLevel};
use volery_rendering::{DrawableMesh, MeshError, Rendering, VirtualCamera};
use volery_scene::{Texture, TexturedMesh, TriangleMesh};
use volery_synthetic::{Hall, Renderer, random_walk};

fn draw(camera: &Camera, mesh: &TriangleMesh) -> Rendering {
    VirtualCamera::new(camera).draw_mesh(&DrawableMesh::new(mesh).unwrap(), &pose())
}

fn rays(camera: &Camera) -> impl Iterator<Item = (usize, Vector3<f64>)> {
    (0..camera.width as usize * camera.height as usize).filter_map(|k| {
        let (x, y) = (k % camera.width as usize, k / camera.width as usize);
        let xy = camera.unproject(&Point2::new(x as f64 + 0.5, y as f64 + 0.5))?;
        Some((k, Vector3::new(xy.x, xy.y, 1.0)))
    })
}

/// Field of view and depth of every model: a wall of two large triangles that fills the view has
/// at each pixel the depth of the ray through its center.
#[test]
fn every_pixel_has_the_depth_of_its_ray() {
    for model in CameraModel::ALL {
        let camera = camera(model);
        let normal = Vector3::new(0.1, -0.05, 1.0);
        let size = 40.0;
        let on_wall = |x: f64, y: f64| Point3::new(x, y, 2.0 - 0.1 * x + 0.05 * y);
        let corner = on_wall(-size, -size);
        let (u, v) = (on_wall(size, -size) - corner, on_wall(-size, size) - corner);
        let mut mesh = TriangleMesh::default();
        add_quad(&mut mesh, corner, u, v, [9; 3]);
        let drawn = draw(&camera, &mesh);
        let mut seen = 0;
        for (k, ray) in rays(&camera) {
            let depth_at = |ray: &Vector3<f64>| 2.0 / normal.dot(ray);
            let depth = depth_at(&ray);
            let within = |v: f64| (v * depth).abs() < 0.99 * size;
            if depth > 0.0 && within(ray.x) && within(ray.y) {
                // As much as a twentieth of a pixel moves it on this wall.
                let (x, y) = ((k % 321) as f64 + 0.55, (k / 321) as f64 + 0.55);
                let beside = camera.unproject(&Point2::new(x, y)).unwrap();
                let slack = (depth_at(&Vector3::new(beside.x, beside.y, 1.0)) - depth).abs();
                let error = (f64::from(drawn.depth[k]) - depth).abs();
                assert!(error < slack + 1e-5 * depth, "{model:?} {k}: {error}, {slack}");
                seen += 1;
            }
        }
        assert!(seen > 70_000, "{model:?}: {seen}");
    }
}

/// Squares fill their outlines as the camera model projects them: the bar is 0.5 pixels, the rays
/// are good to some 0.01.
#[test]
fn surfaces_appear_where_their_points_project() {
    for model in CameraModel::ALL {
        let camera = camera(model);
        let mut mesh = TriangleMesh::default();
        let mut squares = Vec::new();
        for number in 0..49 {
            let (column, row) = (f64::from(number % 7), f64::from(number / 7));
            let xy =
                camera.unproject(&Point2::new(15.0 + 48.0 * column, 15.0 + 35.0 * row)).unwrap();
            let depth = 1.0 + 0.07 * f64::from(number);
            let middle = Point3::new(xy.x, xy.y, 1.0) * depth;
            // Facing the camera, turned, some twenty pixels wide.
            let ray = middle.coords.normalize();
            let across = Vector3::new(0.5, 1.0, 0.0).cross(&ray).normalize();
            let size = 20.0 * middle.coords.norm() / camera.mean_focal();
            let (u, v) = (across * size, ray.cross(&across) * size);
            let corner = middle - (u + v) / 2.0;
            add_quad(&mut mesh, corner, u, v, [number as u8 + 1, 0, 0]);
            squares.push([corner, corner + u, corner + u + v, corner + v]);
        }
        let drawn = draw(&camera, &mesh);
        let mut largest = 0.0_f64;
        for (number, square) in squares.iter().enumerate() {
            let outline: Vec<Point2<f64>> = (0..400)
                .map(|k| {
                    let (from, to) = (square[k / 100], square[(k / 100 + 1) % 4]);
                    camera.project(&(from + (to - from) * (k as f64 / 100.0 - (k / 100) as f64)))
                })
                .map(|pixel| pixel.unwrap())
                .collect();
            for (k, color) in drawn.colors.iter().enumerate() {
                let center = Point2::new((k % 321) as f64 + 0.5, (k / 321) as f64 + 0.5);
                if (center - outline[50]).norm() > 60.0 {
                    continue;
                }
                let is_shown = usize::from(color[0]) == number + 1;
                if is_shown != is_inside(&outline, &center) {
                    largest = largest.max(distance(&outline, &center));
                }
            }
        }
        assert!(largest < 0.1, "{model:?}: {largest}");
    }
}

fn is_inside(outline: &[Point2<f64>], p: &Point2<f64>) -> bool {
    let mut inside = false;
    for (a, b) in outline.iter().zip(outline.iter().cycle().skip(1)) {
        if (a.y > p.y) != (b.y > p.y) && p.x < a.x + (b.x - a.x) * (p.y - a.y) / (b.y - a.y) {
            inside = !inside;
        }
    }
    inside
}

fn distance(outline: &[Point2<f64>], p: &Point2<f64>) -> f64 {
    let to_edge = outline.iter().zip(outline.iter().cycle().skip(1)).map(|(a, b)| {
        let s = ((p - a).dot(&(b - a)) / (b - a).norm_squared()).clamp(0.0, 1.0);
        (a + (b - a) * s - p).norm()
    });
    to_edge.fold(f64::INFINITY, f64::min)
}

/// Depth of the furnished hall against the exact renderer.
#[test]
fn depth_of_a_hall_is_true() {
    let hall = Hall::furnished(Vector3::new(8.0, 6.0, 3.0), 0.05, 3);
    let mesh = DrawableMesh::new(&hall.mesh(0.25)).unwrap();
    for model in [CameraModel::Pinhole, CameraModel::OpenCv] {
        let camera = camera(model);
        let (eye, exact) = (VirtualCamera::new(&camera), Renderer::new(&camera));
        for pose in random_walk(&hall.room, 0.8, 4, 5) {
            let (drawn, truth) = (eye.draw_mesh(&mesh, &pose), exact.render(&hall, &pose));
            assert_eq!(eye.draw_depth(&mesh, &pose), drawn.depth);
            let seen: Vec<(f32, f32)> = drawn.depth.iter().copied().zip(truth.depth).collect();
            let near = seen.iter().filter(|(a, b)| (a - b).abs() < 0.01).count();
            let part = near as f64 / seen.len() as f64;
            // What is left lies on outlines, where a hair decides.
            assert!(part > 0.995, "{model:?}: {part}");
        }
    }
}

/// A floor that runs below and behind the camera: its visible part, no more, no less.
#[test]
fn surfaces_behind_the_camera_are_cut_off() {
    let camera = camera(CameraModel::Pinhole);
    let mut mesh = TriangleMesh::default();
    let (u, v) = (Vector3::x() * 200.0, Vector3::z() * 200.0);
    add_quad(&mut mesh, Point3::new(-100.0, 1.5, -100.0), u, v, [9; 3]);
    let drawn = draw(&camera, &mesh);
    for (k, ray) in rays(&camera) {
        let depth = 1.5 / ray.y;
        if (1e-3..99.0).contains(&depth) && (ray.x * depth).abs() < 99.0 {
            let relative = (f64::from(drawn.depth[k]) / depth - 1.0).abs();
            assert!(relative < 1e-3, "{k}: {} {depth}", drawn.depth[k]);
        } else if !(0.0..101.0).contains(&depth) {
            assert_eq!(drawn.depth[k], 0.0);
        }
    }
}

/// Triangles that cross each other and the near plane, against casting a ray per pixel.
#[test]
fn the_nearest_of_many_triangles_is_seen() {
    let camera = camera(CameraModel::Pinhole);
    let mut rng = Rng::new(4);
    let mut in_cam = Vec::new();
    for _ in 0..60 {
        let middle = Vector3::new(rng.range(-2.0, 2.0), rng.range(-2.0, 2.0), rng.range(-0.5, 4.0));
        in_cam.extend([0; 3].map(|_| Point3::from(middle + 0.8 * rng.normal3())));
    }
    let mesh = TriangleMesh {
        vertices: seen_at(&in_cam),
        triangles: (0..60).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect(),
        colors: Vec::new(),
    };
    let drawn = draw(&camera, &mesh);
    let near = f64::from(VirtualCamera::NEAR);
    let mut differ = 0;
    for (k, ray) in rays(&camera) {
        let hits = in_cam.chunks(3).filter_map(|t| hit(t, &ray)).filter(|&depth| depth >= near);
        let depth = hits.fold(f64::INFINITY, f64::min);
        let truth = if depth.is_finite() { depth } else { 0.0 };
        differ += usize::from((f64::from(drawn.depth[k]) - truth).abs() > 1e-3 * truth);
    }
    // Rays that graze an edge may go either way.
    assert!(differ < 30, "{differ}");
}

/// Depth at which a ray meets a triangle (Möller and Trumbore).
fn hit(triangle: &[Point3<f64>], ray: &Vector3<f64>) -> Option<f64> {
    let (u, v) = (triangle[1] - triangle[0], triangle[2] - triangle[0]);
    let p = ray.cross(&v);
    let s = -triangle[0].coords;
    let q = s.cross(&u);
    let det = u.dot(&p);
    let (a, b) = (s.dot(&p) / det, ray.dot(&q) / det);
    (a >= 0.0 && b >= 0.0 && a + b <= 1.0).then(|| v.dot(&q) / det)
}

/// Neighbors leave no gap, however small they are.
#[test]
fn a_fine_wall_has_no_holes() {
    let camera = camera(CameraModel::OpenCv);
    let mut rng = Rng::new(8);
    let n = 300;
    let mut in_cam = Vec::new();
    for j in 0..=n {
        for i in 0..=n {
            let wobble = if i % n == 0 || j % n == 0 { 0.0 } else { 0.004 };
            let [x, y] = [i, j].map(|k| 4.0 * f64::from(k) / f64::from(n) - 2.0);
            let d = wobble * rng.normal3();
            in_cam.push(Point3::new(x + d.x.clamp(-0.006, 0.006), y, 1.7 + 0.3 * x + d.z));
        }
    }
    let at = |i: u32, j: u32| j * (n as u32 + 1) + i;
    let squares = (0..n as u32).flat_map(|j| (0..n as u32).map(move |i| (i, j)));
    let triangles = squares
        .flat_map(|(i, j)| {
            let (a, b, c, d) = (at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1));
            [[a, b, c], [b, d, c]]
        })
        .collect();
    let mesh = TriangleMesh { vertices: seen_at(&in_cam), triangles, colors: Vec::new() };
    let drawn = draw(&camera, &mesh);
    assert_eq!(drawn.depth.iter().filter(|&&depth| depth == 0.0).count(), 0);
}

/// Colors are linear on the surface, not in the image.
#[test]
fn colors_follow_the_perspective() {
    let camera = camera(CameraModel::Pinhole);
    let corner = Point3::new(-3.0, -0.8, 1.0);
    let (u, v) = (Vector3::new(6.0, 0.0, 4.0), Vector3::y() * 1.6);
    let mut mesh = TriangleMesh::default();
    add_quad(&mut mesh, corner, u, v, [0; 3]);
    mesh.colors = vec![[0, 0, 0], [250, 0, 0], [0, 250, 0], [250, 250, 0]];
    let drawn = draw(&camera, &mesh);
    let normal = u.cross(&v);
    let mut seen = 0;
    for (k, ray) in rays(&camera).filter(|(k, _)| drawn.depth[*k] > 0.0) {
        let on = ray * (normal.dot(&corner.coords) / normal.dot(&ray)) - corner.coords;
        let truth = [u, v].map(|axis| 250.0 * on.dot(&axis) / axis.norm_squared());
        for c in 0..2 {
            let error = (f64::from(drawn.colors[k][c]) - truth[c]).abs();
            assert!(error < 1.0, "{k}: {:?} {truth:?}", drawn.colors[k]);
        }
        seen += 1;
    }
    assert!(seen > 20_000, "{seen}");
}

/// A picture on a slanted wall: every pixel has the color of its place, near and far; triangles
/// past the textured ones show their vertices' colors.
#[test]
fn pictures_lie_where_they_should() {
    let camera = camera(CameraModel::OpenCv);
    let corner = Point3::new(-3.0, -2.0, 1.2);
    let (u, v) = (Vector3::new(6.0, 0.0, 4.0), Vector3::y() * 4.0);
    let mut mesh = TriangleMesh::default();
    add_quad(&mut mesh, corner, u, v, [0; 3]);
    add_quad(&mut mesh, Point3::new(-9.0, -9.0, 20.0), u * 9.0, v * 9.0, [7, 8, 9]);
    // Smooth along x and y, so that places can be read from colors.
    let texture = Texture {
        width: 250,
        height: 200,
        pixels: (0..250 * 200).map(|k| [(k % 250) as u8, (k / 250) as u8, 100]).collect(),
    };
    let square = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]];
    let uvs = [square, square].concat();
    let textured = TexturedMesh { mesh, uvs, num_textured: 2, texture };
    let drawable = DrawableMesh::with_texture(&textured).unwrap();
    let drawn = VirtualCamera::new(&camera).draw_mesh(&drawable, &pose());
    let normal = u.cross(&v);
    let mut seen = 0;
    for (k, ray) in rays(&camera) {
        let on = ray * (normal.dot(&corner.coords) / normal.dot(&ray)) - corner.coords;
        let place = [u, v].map(|axis| on.dot(&axis) / axis.norm_squared());
        if drawn.colors[k] == [7, 8, 9] || place.iter().any(|p| !(0.02..0.98).contains(p)) {
            continue;
        }
        let truth = [250.0 * place[0] - 0.5, 200.0 * place[1] - 0.5];
        for c in 0..2 {
            let error = (f64::from(drawn.colors[k][c]) - truth[c]).abs();
            // Coarse levels are read at the middle of their texels.
            assert!(error < 2.5, "{k}: {:?} {truth:?}", drawn.colors[k]);
        }
        seen += 1;
    }
    assert!(seen > 20_000, "{seen}");
    assert!(drawn.colors.iter().filter(|c| **c == [7, 8, 9]).count() > 1000);
    let bare = TexturedMesh { uvs: Vec::new(), ..textured.clone() };
    assert_eq!(DrawableMesh::with_texture(&bare).unwrap_err(), MeshError::WrongTexture);
    let mut cut = textured;
    cut.texture.pixels.pop();
    assert_eq!(DrawableMesh::with_texture(&cut).unwrap_err(), MeshError::WrongTexture);
}

#[test]
fn instruction_sets_and_threads_change_nothing() {
    let hall = Hall::furnished(Vector3::new(8.0, 6.0, 3.0), 0.05, 3);
    let mesh = DrawableMesh::new(&hall.mesh(0.1)).unwrap();
    for model in [CameraModel::Pinhole, CameraModel::OpenCv] {
        let eye = VirtualCamera::new(&camera(model));
        let pose = random_walk(&hall.room, 0.8, 1, 5)[0];
        let one = rayon_pool(1).install(|| eye.draw_mesh(&mesh, &pose));
        for &level in SimdLevel::available() {
            let many = rayon_pool(3).install(|| eye.draw_mesh_with(level, &mesh, &pose));
            assert!(one == many, "{model:?} {level:?}");
        }
    }
}

fn rayon_pool(threads: usize) -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap()
}

#[test]
fn nothing_is_seen_of_nothing_and_nonsense_is_refused() {
    let camera = camera(CameraModel::Pinhole);
    let empty = draw(&camera, &TriangleMesh::default());
    assert_eq!(empty.seen_part(), 0.0);
    let point = Point3::new(1.0, 2.0, 3.0);
    let flat = TriangleMesh {
        vertices: vec![point; 3],
        triangles: vec![[0, 1, 2], [0, 0, 1]],
        colors: Vec::new(),
    };
    assert_eq!(draw(&camera, &flat).seen_part(), 0.0);
    let refused = |mesh: TriangleMesh| DrawableMesh::new(&mesh).unwrap_err();
    let missing = TriangleMesh { triangles: vec![[0, 1, 3]], ..flat.clone() };
    assert_eq!(refused(missing), MeshError::MissingVertex { triangle: 0 });
    let odd = TriangleMesh { colors: vec![[0; 3]; 2], ..flat.clone() };
    assert_eq!(refused(odd), MeshError::WrongColors { num_colors: 2, num_vertices: 3 });
    let mut wild = flat;
    wild.vertices[2].y = f64::NAN;
    assert_eq!(refused(wild), MeshError::NotFinite { vertex: 2 });
}
