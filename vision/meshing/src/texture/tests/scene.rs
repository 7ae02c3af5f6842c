//! A room whose walls have a known color everywhere, and photos of it.

use std::collections::{BTreeMap, HashMap};
use std::sync::Mutex;

use nalgebra::{Isometry3, Point2, Point3, Vector3};
use volery_geometry::{Camera, CameraModel, Rng};
use volery_scene::{
    CameraId, GrayImage, ImageId, NoProgress, Photo, Photos, RegisteredImage, SparseModel,
    TexturedMesh, TriangleMesh,
};

use crate::test_shapes::ROOM_SIZE;
use crate::texture::{TextureOptions, texture_mesh};

/// Waves of some decimeters: what a texel covers is of nearly one color.
pub(super) fn paint(p: &Point3<f64>) -> [f64; 3] {
    let wave = |t: f64| 120.0 + 60.0 * t.sin();
    [wave(5.0 * p.x + p.z), wave(6.0 * p.y - 2.0 * p.z), wave(7.0 * p.z + 3.0 * p.x)]
}

/// A red board before the wall y = 3, in its middle.
pub(super) const BOARD: [[f64; 2]; 2] = [[1.5, 2.5], [0.8, 1.6]];
pub(super) const BOARD_Y: f64 = 2.4;

#[derive(Clone, Copy)]
pub(super) struct World {
    pub(super) has_board: bool,
}

impl World {
    /// Where a ray from inside ends, and the color there.
    pub(super) fn look(&self, from: &Point3<f64>, ray: &Vector3<f64>) -> (Point3<f64>, [f64; 3]) {
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

    pub(super) fn mesh(&self, step: f64) -> TriangleMesh {
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
pub(super) fn weld(mesh: TriangleMesh) -> TriangleMesh {
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
pub(super) fn add_grid(
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
pub(super) struct Scan {
    pub(super) world: World,
    pub(super) model: SparseModel,
    pub(super) gains: Vec<f64>,
    pub(super) asked: Mutex<BTreeMap<ImageId, u32>>,
}

impl Scan {
    pub(super) fn new(world: World, gain: f64) -> Self {
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

    pub(super) fn texture(&self, mesh: &TriangleMesh) -> TexturedMesh {
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
