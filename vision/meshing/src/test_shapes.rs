//! Shapes with known distance, sampled at random, and what is true of their meshes.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};
use volery_geometry::Rng;
use volery_scene::{OrientedPoint, PointCloud, TriangleMesh};

pub(crate) const TORUS_RADII: [f64; 2] = [1.0, 0.4];

pub(crate) fn sphere(n: usize, seed: u64) -> PointCloud {
    let mut random = Rng::new(seed);
    let mut cloud = PointCloud::default();
    for _ in 0..n {
        let normal = unit_vector(&mut random);
        push(&mut cloud, Point3::from(normal), normal);
    }
    cloud
}

pub(crate) fn unit_vector(random: &mut Rng) -> Vector3<f64> {
    let z = random.range(-1.0, 1.0);
    let angle = random.range(0.0, std::f64::consts::TAU);
    let r = (1.0 - z * z).sqrt();
    Vector3::new(r * angle.cos(), r * angle.sin(), z)
}

/// A torus about z. Where it is sampled `power` > 1 crowds the samples toward +x.
pub(crate) fn torus(n: usize, power: f64, seed: u64) -> PointCloud {
    let mut random = Rng::new(seed);
    let mut cloud = PointCloud::default();
    let [major, minor] = TORUS_RADII;
    while cloud.points.len() < n {
        let a = random.uniform().powf(power) * std::f64::consts::TAU;
        let b = random.range(0.0, std::f64::consts::TAU);
        let radius = major + minor * b.cos();
        if random.uniform() * (major + minor) > radius {
            continue;
        }
        let normal = Vector3::new(b.cos() * a.cos(), b.cos() * a.sin(), b.sin());
        push(&mut cloud, Point3::new(radius * a.cos(), radius * a.sin(), minor * b.sin()), normal);
    }
    cloud
}

pub(crate) fn distance_to_torus(p: &Point3<f64>) -> f64 {
    (p.x.hypot(p.y) - TORUS_RADII[0]).hypot(p.z) - TORUS_RADII[1]
}

/// The inside of a room of 4 x 3 x 2.5 m: normals point inward. `keep` leaves openings.
pub(crate) fn room(n: usize, seed: u64, keep: impl Fn(&Point3<f64>) -> bool) -> PointCloud {
    let size = ROOM_SIZE;
    let mut random = Rng::new(seed);
    let mut cloud = PointCloud::default();
    let areas = [size[1] * size[2], size[0] * size[2], size[0] * size[1]];
    let total: f64 = areas.iter().sum();
    while cloud.points.len() < n {
        let mut choice = random.uniform() * total;
        let axis = areas
            .iter()
            .position(|a| {
                choice -= a;
                choice < 0.0
            })
            .unwrap_or(2);
        let far = random.uniform() < 0.5;
        let mut point = Point3::from(size.map(|s| random.range(0.0, s)));
        point[axis] = if far { size[axis] } else { 0.0 };
        let mut normal = Vector3::zeros();
        normal[axis] = if far { -1.0 } else { 1.0 };
        if keep(&point) {
            push(&mut cloud, point, normal);
        }
    }
    cloud
}

pub(crate) const ROOM_SIZE: [f64; 3] = [4.0, 3.0, 2.5];

/// Distance to the walls of [`room`].
pub(crate) fn distance_to_room(p: &Point3<f64>) -> f64 {
    let outside = Vector3::from_fn(|i, _| (p[i] - ROOM_SIZE[i]).max(-p[i]));
    let far = outside.map(|v| v.max(0.0)).norm();
    if far > 0.0 { far } else { -outside.max() }
}

fn push(cloud: &mut PointCloud, position: Point3<f64>, normal: Vector3<f64>) {
    cloud.points.push(OrientedPoint {
        position: position.cast(),
        normal: normal.cast(),
        color: [128; 3],
        confidence: 255,
        inferred: false,
    });
}

pub(crate) fn positions(cloud: &PointCloud) -> Vec<Point3<f64>> {
    cloud.points.iter().map(|point| point.position.cast()).collect()
}

pub(crate) fn with_noise(mut cloud: PointCloud, sigma: f64, seed: u64) -> PointCloud {
    let mut random = Rng::new(seed);
    for point in &mut cloud.points {
        point.position += (random.normal3() * sigma).cast();
    }
    cloud
}

/// How often each undirected edge is used, and whether its two uses run in opposite directions.
pub(crate) fn is_closed(mesh: &TriangleMesh) -> bool {
    let mut edges: HashMap<[u32; 2], [u32; 2]> = HashMap::new();
    for &[a, b, c] in &mesh.triangles {
        for [from, to] in [[a, b], [b, c], [c, a]] {
            let uses = edges.entry([from.min(to), from.max(to)]).or_default();
            uses[usize::from(from < to)] += 1;
        }
    }
    edges.values().all(|&uses| uses == [1, 1])
}

/// Vertices − edges + faces of a closed mesh; 2 − 2 genus if it is one piece.
pub(crate) fn euler_number(mesh: &TriangleMesh) -> i64 {
    let mut used = vec![false; mesh.vertices.len()];
    mesh.triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
    let vertices = used.iter().filter(|&&used| used).count() as i64;
    let faces = mesh.triangles.len() as i64;
    vertices - faces * 3 / 2 + faces
}

/// Positive if the triangles are counterclockwise seen from outside.
pub(crate) fn volume(mesh: &TriangleMesh) -> f64 {
    let at = |v: u32| mesh.vertices[v as usize].coords;
    mesh.triangles.iter().map(|&[a, b, c]| at(a).dot(&at(b).cross(&at(c))) / 6.0).sum()
}

/// Root mean square of a distance over the vertices.
pub(crate) fn rms(mesh: &TriangleMesh, distance: impl Fn(&Point3<f64>) -> f64) -> f64 {
    let sum: f64 = mesh.vertices.iter().map(|v| distance(v).powi(2)).sum();
    (sum / mesh.vertices.len() as f64).sqrt()
}
