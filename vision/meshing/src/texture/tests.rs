//! A room whose walls have a known color everywhere.

use std::collections::{BTreeMap, HashMap};
use std::sync::Mutex;

use nalgebra::{Isometry3, Point2, Point3, Vector3};
use volery_geometry::{Camera, CameraModel, Rng};
use volery_scene::{
    CameraId, GrayImage, ImageId, NoProgress, Photo, Photos, RegisteredImage, SparseModel,
    TriangleMesh,
};

use super::labels::{Candidate, SEAM_COST};
use super::*;
use crate::test_shapes::ROOM_SIZE;

/// Waves of some decimeters: what a texel covers is of nearly one color.
fn paint(p: &Point3<f64>) -> [f64; 3] {
    let wave = |t: f64| 120.0 + 60.0 * t.sin();
    [wave(5.0 * p.x + p.z), wave(6.0 * p.y - 2.0 * p.z), wave(7.0 * p.z + 3.0 * p.x)]
}

/// A red board before the wall y = 3, in its middle.
const BOARD: [[f64; 2]; 2] = [[1.5, 2.5], [0.8, 1.6]];
const BOARD_Y: f64 = 2.4;

#[derive(Clone, Copy)]
struct World {
    has_board: bool,
}

impl World {
    /// Where a ray from inside ends, and the color there.
    fn look(&self, from: &Point3<f64>, ray: &Vector3<f64>) -> (Point3<f64>, [f64; 3]) {
        let mut t = f64::INFINITY;
        for axis in 0..3 {
            let wall = if ray[axis] > 0.0 { ROOM_SIZE[axis] } else { 0.0 };
            if ray[axis] != 0.0 {
                t = t.min((wall - from[axis]) / ray[axis]);
            }
        }
        if self.has_board {
            let s = (BOARD_Y - from.y) / ray.y;
            let p = from + ray * s;
            let [x, z] = BOARD;
            if s > 0.0 && s < t && (x[0]..x[1]).contains(&p.x) && (z[0]..z[1]).contains(&p.z) {
                return (p, [220.0, 10.0, 10.0]);
            }
        }
        (from + ray * t, paint(&(from + ray * t)))
    }

    fn mesh(&self, step: f64) -> TriangleMesh {
        let mut mesh = TriangleMesh::default();
        for (axis, &size) in ROOM_SIZE.iter().enumerate() {
            let [u, v] = [(axis + 1) % 3, (axis + 2) % 3].map(|a| (a, [0.0, ROOM_SIZE[a]]));
            // Seen from inside: the near wall's normal is +axis.
            add_grid(&mut mesh, (axis, 0.0), u, v, step);
            add_grid(&mut mesh, (axis, size), v, u, step);
        }
        if self.has_board {
            let [x, z] = BOARD;
            // Its front looks to -y, its back to +y.
            add_grid(&mut mesh, (1, BOARD_Y), (0, x), (2, z), step);
            add_grid(&mut mesh, (1, BOARD_Y + 0.05), (2, z), (0, x), step);
        }
        weld(mesh)
    }
}

/// Vertices in one place become one.
fn weld(mesh: TriangleMesh) -> TriangleMesh {
    let mut welded = TriangleMesh::default();
    let mut place = HashMap::new();
    let numbers: Vec<u32> = mesh
        .vertices
        .iter()
        .map(|p| {
            *place.entry([p.x, p.y, p.z].map(f64::to_bits)).or_insert_with(|| {
                welded.vertices.push(*p);
                welded.vertices.len() as u32 - 1
            })
        })
        .collect();
    welded.triangles = mesh.triangles.iter().map(|t| t.map(|v| numbers[v as usize])).collect();
    welded
}

/// A rectangle whose normal is the cross product of the axes u and v.
fn add_grid(
    mesh: &mut TriangleMesh,
    (axis, height): (usize, f64),
    (u, u_range): (usize, [f64; 2]),
    (v, v_range): (usize, [f64; 2]),
    step: f64,
) {
    let count = |[low, high]: [f64; 2]| ((high - low) / step).ceil() as u32;
    let (nu, nv) = (count(u_range), count(v_range));
    let first = mesh.vertices.len() as u32;
    for (i, j) in (0..=nv).flat_map(|j| (0..=nu).map(move |i| (i, j))) {
        let mut p = Point3::origin();
        let at = |[low, high]: [f64; 2], i: u32, n: u32| {
            low + (high - low) * f64::from(i) / f64::from(n)
        };
        (p[axis], p[u], p[v]) = (height, at(u_range, i, nu), at(v_range, j, nv));
        mesh.vertices.push(p);
    }
    for (i, j) in (0..nv).flat_map(|j| (0..nu).map(move |i| (i, j))) {
        let a = first + j * (nu + 1) + i;
        let (b, c) = (a + 1, a + nu + 1);
        mesh.triangles.extend([[a, b, c], [b, c + 1, c]]);
    }
}

/// Cameras with a lens that distorts, each with its own exposure.
struct Scan {
    world: World,
    model: SparseModel,
    gains: Vec<f64>,
    asked: Mutex<BTreeMap<ImageId, u32>>,
}

impl Scan {
    fn new(world: World, gain: f64) -> Self {
        let parameters = [90.0, 80.0, 60.0, -0.12, 0.02];
        let camera = Camera::new(CameraModel::Radial, 160, 120, &parameters).unwrap();
        let mut model = SparseModel::default();
        model.cameras.insert(CameraId(0), camera);
        let (mut random, mut gains) = (Rng::new(4), Vec::new());
        for pitch in [-1.3, -0.5, 0.5, 1.3_f64] {
            for turn in 0..10_u32 {
                let yaw = f64::from(turn) * std::f64::consts::TAU / 10.0;
                let ahead =
                    Vector3::new(yaw.cos() * pitch.cos(), yaw.sin() * pitch.cos(), pitch.sin());
                let eye = Point3::new(2.0, 1.3, 1.2) + random.normal3() * 0.1;
                // The camera's z looks ahead, its y down.
                let cam_from_world = Isometry3::look_at_rh(&eye, &(eye + ahead), &Vector3::z());
                let flip = nalgebra::UnitQuaternion::from_axis_angle(
                    &Vector3::x_axis(),
                    std::f64::consts::PI,
                );
                let id = ImageId(model.images.len() as u32);
                let image = RegisteredImage {
                    name: format!("{}.png", id.0),
                    camera: CameraId(0),
                    cam_from_world: flip * cam_from_world,
                    keypoints: Vec::new(),
                    points: Vec::new(),
                };
                model.images.insert(id, image);
                gains.push(random.range(1.0 - gain, 1.0 + gain));
            }
        }
        Self { world, model, gains, asked: Mutex::default() }
    }

    fn texture(&self, mesh: &TriangleMesh) -> TexturedMesh {
        texture_mesh(mesh, &self.model, self, &TextureOptions::default(), &NoProgress).unwrap()
    }
}

impl Photos for Scan {
    fn photo(&self, image: ImageId) -> Option<Photo> {
        *self.asked.lock().unwrap().entry(image).or_default() += 1;
        let camera = &self.model.cameras[&CameraId(0)];
        let registered = &self.model.images[&image];
        let (eye, world_from_cam) =
            (registered.center(), registered.cam_from_world.rotation.inverse());
        let gain = self.gains[image.0 as usize];
        let color = |i: u32| {
            let pixel = Point2::new(f64::from(i % 160) + 0.5, f64::from(i / 160) + 0.5);
            let ray = world_from_cam * camera.bearing(&pixel).unwrap().into_inner();
            self.world.look(&eye, &ray).1.map(|v| (v * gain).round() as u8)
        };
        let colors: Vec<[u8; 3]> = (0..160 * 120).map(color).collect();
        let gray = GrayImage::new(160, 120, vec![0; 160 * 120]).unwrap();
        Some(Photo { gray, colors: Some(colors) })
    }
}

fn color_at(textured: &TexturedMesh, uv: [f64; 2]) -> [f64; 3] {
    let texture = &textured.texture;
    let (width, height) = (texture.width as usize, texture.height as usize);
    let at = Point2::new(uv[0] * width as f64, uv[1] * height as f64);
    paint::between(&at, width, height, |x, y| texture.pixels[y * width + x])
}

/// Points of the seen triangles with the color that the texture gives them.
fn samples(textured: &TexturedMesh, per_triangle: usize) -> Vec<(Point3<f64>, [f64; 3])> {
    let mut random = Rng::new(9);
    let seen = textured.mesh.triangles[..textured.num_textured].iter();
    seen.flat_map(|triangle| std::iter::repeat_n(*triangle, per_triangle))
        .map(|triangle| {
            let (mut s, mut t) = (random.uniform(), random.uniform());
            if s + t > 1.0 {
                (s, t) = (1.0 - s, 1.0 - t);
            }
            let weights = [1.0 - s - t, s, t];
            let (mut point, mut uv) = (Vector3::zeros(), [0.0; 2]);
            for (v, w) in triangle.into_iter().zip(weights) {
                point += textured.mesh.vertices[v as usize].coords * w;
                let corner = textured.uvs[v as usize];
                (0..2).for_each(|k| uv[k] += f64::from(corner[k]) * w);
            }
            (Point3::from(point), color_at(textured, uv))
        })
        .collect()
}

fn error(found: &[f64; 3], truth: &[f64; 3]) -> f64 {
    found.iter().zip(truth).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

fn quantile(mut values: Vec<f64>, q: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * q) as usize]
}

/// Dies if a texel is off by one, if the lens is forgotten, or if v runs upward.
#[test]
fn walls_have_their_colors() {
    let scan = Scan::new(World { has_board: false }, 0.0);
    let mesh = scan.world.mesh(0.25);
    let textured = scan.texture(&mesh);
    assert_eq!(textured.num_textured, mesh.triangles.len());
    let errors =
        samples(&textured, 20).iter().map(|(p, c)| error(c, &paint(p))).collect::<Vec<_>>();
    // Half of the gray levels of rounding, and the bend of a wave within a texel of 3 cm.
    let [median, p99] = [0.5, 0.99].map(|q| quantile(errors.clone(), q));
    assert!(median < 1.0 && p99 < 5.0, "{median} {p99}");
    assert!(scan.asked.lock().unwrap().values().all(|&count| count == 1));
}

/// A pixel of 160 x 120 covers 3 cm: large triangles must not bend the picture.
#[test]
fn large_triangles_are_painted_as_exactly() {
    let scan = Scan::new(World { has_board: false }, 0.0);
    let textured = scan.texture(&scan.world.mesh(0.8));
    assert!(textured.num_textured > 0);
    let errors = samples(&textured, 100).iter().map(|(p, c)| error(c, &paint(p))).collect();
    let p99 = quantile(errors, 0.99);
    assert!(p99 < 5.0, "{p99}");
}

/// Differences of the colors at vertices that are in several charts.
fn seam_differences(textured: &TexturedMesh) -> Vec<f64> {
    let mut first: HashMap<[u64; 3], [f64; 3]> = HashMap::new();
    let mut found = Vec::new();
    for (vertex, uv) in textured.mesh.vertices.iter().zip(&textured.uvs) {
        let color = color_at(textured, uv.map(f64::from));
        let key = [vertex.x, vertex.y, vertex.z].map(f64::to_bits);
        match first.get(&key) {
            Some(other) => found.push(error(&color, other)),
            None => drop(first.insert(key, color)),
        }
    }
    found
}

/// Exposures differ by up to 40 %: about 40 levels at a seam.
#[test]
fn seams_are_leveled() {
    let world = World { has_board: false };
    let textured = Scan::new(world, 0.2).texture(&world.mesh(0.25));
    let differences = seam_differences(&textured);
    assert!(differences.len() > 100, "{}", differences.len());
    let [median, p95] = [0.5, 0.95].map(|q| quantile(differences.clone(), q));
    assert!(median < 3.0 && p95 < 12.0, "{median} {p95}");
}

/// The wall behind the board is seen past it or not at all, never through it.
#[test]
fn nothing_is_painted_through_a_board() {
    let scan = Scan::new(World { has_board: true }, 0.0);
    let mesh = scan.world.mesh(0.1);
    let textured = scan.texture(&mesh);
    let unseen = &textured.mesh.triangles[textured.num_textured..];
    let at = |v: u32| textured.mesh.vertices[v as usize];
    let is_hidden = |p: &Point3<f64>| p.y > BOARD_Y + 0.01 && p.y < ROOM_SIZE[1] + 0.01;
    assert!(unseen.len() > 50 && unseen.iter().flatten().all(|&v| is_hidden(&at(v))));
    let [x, z] = BOARD;
    // A pixel covers 3 cm: the colors of the board and of the wall mix along its edge.
    let inset = |v: f64, [low, high]: [f64; 2]| (v - low).min(high - v);
    for (point, color) in samples(&textured, 4) {
        let is_red = color[1] < 40.0;
        let is_on_board = (point.y - BOARD_Y).abs() < 1e-9;
        let from_edge = inset(point.x, x).min(inset(point.z, z));
        assert!(is_red == is_on_board || from_edge < 0.05, "{color:?} at {point}");
    }
}

#[test]
fn no_two_triangles_share_a_texel() {
    let scan = Scan::new(World { has_board: false }, 0.0);
    let textured = scan.texture(&scan.world.mesh(0.25));
    let (width, height) = (textured.texture.width, textured.texture.height);
    assert!(width.is_power_of_two() && height.is_power_of_two() && width <= 4096);
    assert_eq!(textured.texture.pixels.len(), (width * height) as usize);
    assert_eq!(textured.uvs.len(), textured.mesh.vertices.len());
    assert!(textured.uvs.iter().flatten().all(|v| (0.0..=1.0).contains(v)));
    let mut owners = HashMap::new();
    for (index, triangle) in textured.mesh.triangles.iter().enumerate() {
        let [a, b, c] = triangle.map(|v| {
            let [u, v] = textured.uvs[v as usize].map(f64::from);
            Point2::new(u * f64::from(width), v * f64::from(height))
        });
        let area = (b - a).perp(&(c - a));
        let (low, high) = (a.inf(&b).inf(&c), a.sup(&b).sup(&c));
        for y in low.y as u32..=high.y as u32 {
            for x in low.x as u32..=high.x as u32 {
                let p = Point2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
                let inside = [(a, b), (b, c), (c, a)]
                    .iter()
                    .all(|(p0, p1)| (p1 - p0).perp(&(p - p0)) * area.signum() > 1e-3);
                if inside && let Some(other) = owners.insert((x, y), index) {
                    panic!("{other} and {index} share texel {x}, {y}");
                }
            }
        }
    }
}

#[test]
fn a_small_texture_holds_the_same_picture_smaller() {
    let scan = Scan::new(World { has_board: false }, 0.0);
    let mesh = scan.world.mesh(0.25);
    let options = TextureOptions { max_side: 128 };
    let textured = texture_mesh(&mesh, &scan.model, &scan, &options, &NoProgress).unwrap();
    assert!(textured.texture.width <= 128 && textured.texture.height <= 128);
    let errors = samples(&textured, 10).iter().map(|(p, c)| error(c, &paint(p))).collect();
    let median = quantile(errors, 0.5);
    assert!(median < 6.0, "{median}");
}

#[test]
fn threads_do_not_matter() {
    let mesh = World { has_board: true }.mesh(0.25);
    let with = |num_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(num_threads).build().unwrap();
        let (world, mesh) = (World { has_board: true }, &mesh);
        pool.install(|| Scan::new(world, 0.2).texture(mesh))
    };
    assert!(with(1) == with(3));
}

#[test]
fn what_cannot_be_painted_is_named() {
    let scan = Scan::new(World { has_board: false }, 0.0);
    let mesh = scan.world.mesh(0.5);
    let run = |mesh: &TriangleMesh, model: &SparseModel, photos: &dyn Photos, max_side: u32| {
        texture_mesh(mesh, model, photos, &TextureOptions { max_side }, &NoProgress).unwrap_err()
    };
    let empty = TriangleMesh::default();
    assert_eq!(run(&empty, &scan.model, &scan, 4096), MeshingError::NoTriangles);
    assert!(matches!(run(&mesh, &scan.model, &scan, 1000), MeshingError::Option { .. }));
    let nobody = SparseModel::default();
    assert_eq!(run(&mesh, &nobody, &scan, 4096), MeshingError::NothingSeen);
    // From outside, the room turns its back to every camera.
    let mut outside = scan.model.clone();
    outside.transform(&nalgebra::Similarity3::new(
        Vector3::new(50.0, 0.0, 0.0),
        Vector3::zeros(),
        1.0,
    ));
    assert_eq!(run(&mesh, &outside, &scan, 4096), MeshingError::NothingSeen);
    let mut broken = mesh.clone();
    broken.triangles[3][1] = 1 << 30;
    assert_eq!(run(&broken, &nobody, &scan, 64), MeshingError::NoSuchVertex { triangle: 3 });
    broken.clone_from(&mesh);
    broken.vertices[7].x = f64::NAN;
    assert_eq!(run(&broken, &nobody, &scan, 64), MeshingError::NotFinite { index: 7 });
    struct Lost;
    impl Photos for Lost {
        fn photo(&self, _image: ImageId) -> Option<Photo> {
            None
        }
    }
    assert!(matches!(run(&mesh, &scan.model, &Lost, 4096), MeshingError::NoPhoto { .. }));
    struct Small;
    impl Photos for Small {
        fn photo(&self, _image: ImageId) -> Option<Photo> {
            Some(Photo { gray: GrayImage::new(2, 2, vec![0; 4])?, colors: None })
        }
    }
    assert!(matches!(run(&mesh, &scan.model, &Small, 4096), MeshingError::WrongSize { .. }));
}

/// On a strip of triangles, a tree, the labels are the best of all.
#[test]
fn labels_of_a_strip_are_the_cheapest() {
    let count = 9;
    let strip = TriangleMesh {
        vertices: (0..count + 2)
            .map(|i| Point3::new(f64::from(i / 2), f64::from(i % 2), 0.0))
            .collect(),
        triangles: (0..count).map(|i| [i, i + 1, i + 2]).collect(),
        colors: Vec::new(),
    };
    let fans = Fans::new(strip.vertices.len(), &strip.triangles);
    let mut random = Rng::new(11);
    for _ in 0..20 {
        let candidates: Vec<Vec<Candidate>> = (0..count)
            .map(|_| {
                let of = |view: u32, random: &mut Rng| Candidate {
                    view,
                    quality: random.range(0.2, 1.0) as f32,
                };
                let mut list: Vec<_> = (0..3).map(|view| of(view, &mut random)).collect();
                list.remove((random.uniform() * 3.0) as usize % 3);
                list
            })
            .collect();
        // All triangles are alike; inner edges are 1 and √2 long.
        let lengths: Vec<f64> =
            (1..count).map(|i| if i % 2 == 1 { 2.0_f64.sqrt() } else { 1.0 }).collect();
        let mean = lengths.iter().sum::<f64>() / lengths.len() as f64;
        let cost = |labels: &[u32]| {
            let data: f64 = candidates
                .iter()
                .zip(labels)
                .map(|(list, label)| {
                    let best = list.iter().map(|c| c.quality).fold(0.0, f32::max);
                    let own = list.iter().find(|c| c.view == *label);
                    own.map_or(f64::INFINITY, |c| 1.0 - f64::from(c.quality / best))
                })
                .sum();
            let seams = labels.windows(2).zip(&lengths).filter(|(pair, _)| pair[0] != pair[1]);
            data + seams.map(|(_, length)| f64::from(SEAM_COST) * length / mean).sum::<f64>()
        };
        let found: Vec<u32> = choose_views(&strip, &fans, candidates.clone())
            .into_iter()
            .map(|l| l.unwrap())
            .collect();
        let all = (0..3_u32.pow(count)).map(|code| {
            let labels: Vec<u32> = (0..count).map(|i| code / 3_u32.pow(i) % 3).collect();
            cost(&labels)
        });
        let least = all.fold(f64::INFINITY, f64::min);
        assert!(cost(&found) < least + 1e-5, "{} {least}", cost(&found));
    }
}
