use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use volery_scene::{NoProgress, OrientedPoint, PointCloud, Progress, Stage};

use super::*;
use crate::test_shapes::*;

fn options(depth: u32) -> PoissonOptions {
    PoissonOptions { depth, ..PoissonOptions::default() }
}

fn surface(cloud: &PointCloud, depth: u32) -> Surface {
    reconstruct_surface(cloud, &options(depth), &NoProgress).unwrap()
}

/// Side of the finest cells of a cloud whose longest side is `extent`.
fn cell_side(extent: f64, depth: u32) -> f64 {
    1.1 * extent / f64::from(1u32 << depth)
}

#[test]
fn a_sphere_is_closed_in_one_piece_and_where_it_should_be() {
    let surface = surface(&sphere(20_000, 1), 7);
    assert!(is_closed(&surface.mesh));
    assert_eq!(euler_number(&surface.mesh), 2);
    let error = rms(&surface.mesh, |p| p.coords.norm() - 1.0);
    assert!(error < 0.05 * cell_side(2.0, 7), "{error}");
    let volume = volume(&surface.mesh) / (4.0 / 3.0 * std::f64::consts::PI);
    assert!((volume - 1.0).abs() < 2e-3, "outward, and of the sphere's volume: {volume}");
}

/// Samples crowd on one side, so that the leaves on the surface have many sizes.
#[test]
fn a_torus_of_uneven_density_has_its_hole_and_no_crack() {
    let cloud = torus(30_000, 4.0, 2);
    let surface = surface(&cloud, 9);
    assert!(is_closed(&surface.mesh));
    assert_eq!(euler_number(&surface.mesh), 0);
    // The cells grow where samples are rare: one sixtieth of the tube there.
    let error = rms(&surface.mesh, distance_to_torus);
    assert!(error < 0.4 / 60.0, "{error}");
    let smallest =
        surface.mesh.triangles.iter().map(|t| edge(&surface.mesh, t)).fold(1.0, f64::min);
    let largest = surface.mesh.triangles.iter().map(|t| edge(&surface.mesh, t)).fold(0.0, f64::max);
    assert!(largest > 8.0 * smallest.max(1e-3), "the tree did not adapt");
}

fn edge(mesh: &TriangleMesh, &[a, b, _]: &[u32; 3]) -> f64 {
    (mesh.vertices[a as usize] - mesh.vertices[b as usize]).norm()
}

/// Seen from inside: the walls face the room, and the closed surface encloses the air.
#[test]
fn a_room_is_closed_and_faces_inward() {
    let surface = surface(&room(40_000, 3, |_| true), 7);
    assert!(is_closed(&surface.mesh));
    assert_eq!(euler_number(&surface.mesh), 2);
    let volume = volume(&surface.mesh);
    assert!((volume + 4.0 * 3.0 * 2.5).abs() < 0.3, "{volume}");
    let error = rms(&surface.mesh, distance_to_room);
    assert!(error < 0.25 * cell_side(4.0, 7), "{error}");
}

/// The sum of many errors is small: the surface lies deep below the noise.
#[test]
fn noise_is_averaged() {
    let sigma = 0.01;
    let cloud = with_noise(sphere(60_000, 4), sigma, 5);
    let surface = surface(&cloud, 6);
    assert!(is_closed(&surface.mesh));
    let error = rms(&surface.mesh, |p| p.coords.norm() - 1.0);
    assert!(error < 0.3 * sigma, "{error}");
}

/// Where the surface lies in its cells does not matter: not where tents are bent (to a hundredth of
/// a cell without their bend in mind), nor where a line along an edge would be.
#[test]
fn a_surface_without_noise_is_found_to_hundredths_of_a_cell() {
    for (cloud, extent, distance) in [
        (sphere(60_000, 14), 2.0, (|p| p.coords.norm() - 1.0) as fn(&Point3<f64>) -> f64),
        (torus(60_000, 1.0, 15), 2.8, distance_to_torus),
    ] {
        let error = rms(&surface(&cloud, 6).mesh, distance) / cell_side(extent, 6);
        assert!(error < 0.007, "{error} cells");
    }
}

/// P56: the screen draws the surface to the samples.
#[test]
fn screened_is_nearer_to_the_samples_than_unscreened() {
    let cloud = torus(30_000, 1.5, 6);
    let error = |screening: f64| {
        let options = PoissonOptions { screening, ..options(7) };
        rms(&reconstruct_surface(&cloud, &options, &NoProgress).unwrap().mesh, distance_to_torus)
    };
    let (screened, unscreened) = (error(2.0), error(0.0));
    assert!(screened < 0.7 * unscreened, "{screened} against {unscreened}");
}

#[test]
fn threads_do_not_matter() {
    let cloud = torus(20_000, 2.0, 7);
    let with_threads = |num_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(num_threads).build().unwrap();
        pool.install(|| surface(&cloud, 8))
    };
    assert_eq!(with_threads(1), with_threads(2));
}

/// The order of the points does not matter either, up to rounding.
#[test]
fn a_moved_and_scaled_cloud_gives_the_moved_and_scaled_surface() {
    let cloud = sphere(5_000, 8);
    let plain = surface(&cloud, 6);
    let move_by = Isometry3::from_parts(Translation3::new(1e3, -2e2, 5.0), nalgebra::one());
    let mut moved = cloud.clone();
    for point in &mut moved.points {
        point.position = (move_by * (point.position.cast::<f64>() * 8.0)).cast();
    }
    let moved = surface(&moved, 6);
    assert!(
        (moved.mesh.vertices.len() as f64 / plain.mesh.vertices.len() as f64 - 1.0).abs() < 0.01
    );
    let center = move_by * Point3::origin();
    let error = rms(&moved.mesh, |p| (p - center).norm() / 8.0 - 1.0);
    assert!(error < 0.1 * cell_side(2.0, 6), "{error}");
}

/// Few points, sparse points at the border of the cube, the coarsest tree.
#[test]
fn sparse_clouds_give_closed_surfaces() {
    for (n, depth) in [(400, 8), (2000, 4), (2000, 5)] {
        let surface = surface(&sphere(n, 9), depth);
        assert!(is_closed(&surface.mesh), "{n} points");
        let error = rms(&surface.mesh, |p| p.coords.norm() - 1.0);
        assert!(error < 0.1, "{n} points: {error}");
    }
    // Too few for any shape: whatever comes is finite.
    let mesh = surface(&sphere(3, 9), 9).mesh;
    assert!(mesh.vertices.iter().all(|v| v.iter().all(|c| c.is_finite())));
}

/// Densities are samples per area: 10 000 on 4π.
#[test]
fn densities_count_samples_per_area() {
    let surface = surface(&sphere(10_000, 10), 7);
    let mean = surface.densities.iter().map(|&d| f64::from(d)).sum::<f64>()
        / surface.densities.len() as f64;
    let truth = 10_000.0 / (4.0 * std::f64::consts::PI);
    assert!((mean / truth - 1.0).abs() < 0.1, "{mean} against {truth}");
    assert_eq!(surface.densities.len(), surface.mesh.vertices.len());
}

#[test]
fn a_plane_of_points_lies_in_its_surface() {
    let wall = room(20_000, 11, |p| p.z == 0.0);
    let surface = surface(&wall, 7);
    // What no sample supports may go anywhere; the floor itself is found.
    for x in 1..8 {
        for y in 1..6 {
            let at = Point3::new(0.5 * f64::from(x), 0.5 * f64::from(y), 0.0);
            let nearest =
                surface.mesh.vertices.iter().map(|v| (v - at).norm()).fold(f64::INFINITY, f64::min);
            assert!(nearest < 1.5 * cell_side(4.0, 7), "{at}");
        }
    }
}

#[test]
fn bad_input_is_named() {
    let good = sphere(100, 12);
    let refused =
        |cloud: &PointCloud| reconstruct_surface(cloud, &options(6), &NoProgress).unwrap_err();
    assert_eq!(refused(&PointCloud::default()), MeshingError::TooFewPoints { got: 0 });
    let mut one = good.clone();
    one.points.truncate(1);
    assert_eq!(refused(&one), MeshingError::TooFewPoints { got: 1 });
    let changed = |change: fn(&mut OrientedPoint)| {
        let mut cloud = good.clone();
        change(&mut cloud.points[7]);
        refused(&cloud)
    };
    let not_finite = MeshingError::NotFinite { index: 7 };
    assert_eq!(changed(|point| point.position.y = f32::NAN), not_finite);
    assert_eq!(changed(|point| point.normal.x = f32::INFINITY), not_finite);
    let not_a_normal = MeshingError::NotANormal { index: 7 };
    assert_eq!(changed(|point| point.normal = Vector3::zeros()), not_a_normal);
    assert_eq!(changed(|point| point.normal *= 1e30), not_a_normal);
    let same = PointCloud { points: vec![good.points[0]; 100] };
    assert_eq!(refused(&same), MeshingError::SamePlace);
    for options in [
        PoissonOptions { depth: 3, ..options(6) },
        PoissonOptions { depth: 13, ..options(6) },
        PoissonOptions { screening: -1.0, ..options(6) },
        PoissonOptions { screening: f64::NAN, ..options(6) },
        PoissonOptions { samples_per_cell: 0.0, ..options(6) },
    ] {
        assert!(reconstruct_surface(&good, &options, &NoProgress).is_err(), "{options:?}");
    }
}

struct Impatient;

impl Progress for Impatient {
    fn report(&self, _stage: Stage, _done: usize, _total: usize) {}

    fn is_cancelled(&self) -> bool {
        true
    }
}

#[test]
fn work_that_is_cancelled_says_so() {
    let answer = reconstruct_surface(&sphere(100, 13), &options(6), &Impatient);
    assert_eq!(answer.unwrap_err(), MeshingError::Cancelled(volery_scene::Cancelled));
}
