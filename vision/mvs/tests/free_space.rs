//! Free space of a rendered room against what is in it.

mod support;

use support::{Scan, pinhole, scan};
use volery_geometry::{Point3, Rng};
use volery_mvs::SpaceCarver;
use volery_scene::{DepthMap, Occupancy, OccupancyGrid};

const VOXEL: f64 = 0.1;

/// The depths that the views have in truth.
fn true_maps(scan: &Scan) -> Vec<DepthMap> {
    let map = |(image, rendering): (_, &volery_synthetic::Rendering)| {
        let pose = scan.model.images[image].cam_from_world;
        let mut map = DepthMap::empty(*image, scan.camera, pose);
        map.depth.clone_from(&rendering.depth);
        map
    };
    scan.model.images.keys().zip(&scan.renderings).map(map).collect()
}

/// The box around the whole room and half a meter of what is behind its walls.
fn carved(scan: &Scan, maps: &[DepthMap]) -> OccupancyGrid {
    let shell = scan.hall.room.shell();
    let reach = shell.half.add_scalar(0.5);
    let mut carver = SpaceCarver::new(shell.center - reach, shell.center + reach, VOXEL).unwrap();
    maps.iter().for_each(|map| carver.add(map));
    carver.finish()
}

fn centers(grid: &OccupancyGrid, state: Occupancy) -> Vec<Point3<f64>> {
    let states = grid.states().iter().enumerate();
    states.filter(|(_, other)| **other == state).map(|(index, _)| grid.center(index)).collect()
}

/// Number of views that see a point of the air.
fn num_seeing(scan: &Scan, point: &Point3<f64>, margin_px: f64) -> usize {
    let sees = |image: &&volery_scene::RegisteredImage| {
        let pixel = scan.camera.project(&(image.cam_from_world * point));
        let [width, height] = [scan.camera.width, scan.camera.height].map(f64::from);
        pixel.is_some_and(|p| p.x.min(width - p.x).min(p.y).min(height - p.y) > margin_px)
            && scan.hall.room.sees(&image.center(), point)
    };
    scan.model.images.values().filter(sees).count()
}

/// No free voxel has a corner in a solid, nor is there one that no camera sees.
fn assert_free_is_free(scan: &Scan, grid: &OccupancyGrid) {
    let free = centers(grid, Occupancy::Free);
    assert!(free.len() > 3000, "{}", free.len());
    for center in &free {
        for corner in 0..8 {
            let side = |bit: usize| if corner >> bit & 1 == 0 { -0.5 } else { 0.5 } * VOXEL;
            let corner = center + nalgebra::Vector3::new(side(0), side(1), side(2));
            assert!(scan.hall.room.is_free(&corner, 0.0), "{center} reaches into a solid");
        }
        assert!(num_seeing(scan, center, 0.0) > 0, "nobody sees {center}");
    }
}

#[test]
fn free_is_what_cameras_see_through() {
    let scan = scan(pinhole(240), 7);
    let grid = carved(&scan, &true_maps(&scan));
    assert_free_is_free(&scan, &grid);
    // Air that several views see, away from surfaces, is known to be free.
    let room = &scan.hall.room;
    let air: Vec<usize> = (0..grid.states().len())
        .filter(|&index| {
            let center = grid.center(index);
            room.is_free(&center, 0.0)
                && room.distance_to_surface(&center) > 1.5 * VOXEL
                && num_seeing(&scan, &center, 12.0) >= 4
        })
        .collect();
    let free = air.iter().filter(|&&index| grid.states()[index] == Occupancy::Free).count();
    assert!(air.len() > 4000 && free * 100 > air.len() * 90, "{free} of {}", air.len());
    // What is occupied holds a surface.
    for center in centers(&grid, Occupancy::Occupied) {
        assert!(room.distance_to_surface(&center) <= 0.5 * 3.0_f64.sqrt() * VOXEL + 0.005);
    }
    // Surfaces that several views see are occupied.
    let mut rng = Rng::new(4);
    let surface: Vec<Point3<f64>> = (0..8000)
        .map(|_| room.surface_point(&mut rng).position)
        .filter(|point| num_seeing(&scan, point, 4.0) >= 4)
        .collect();
    let occupied =
        surface.iter().filter(|point| grid.state_at(point) == Occupancy::Occupied).count();
    assert!(
        surface.len() > 300 && occupied * 100 > surface.len() * 80,
        "{occupied} of {}",
        surface.len()
    );
}

/// Depths off by a percent, a tenth of them unknown, in pieces, and a few wrong ones.
#[test]
fn bad_depths_make_no_free_space() {
    let scan = scan(pinhole(240), 7);
    let mut maps = true_maps(&scan);
    let mut rng = Rng::new(8);
    for map in &mut maps {
        for depth in &mut map.depth {
            *depth *= 1.0 + 0.005 * rng.normal() as f32;
        }
        for _ in 0..60 {
            let (left, top) = (rng.range(0.0, 220.0) as usize, rng.range(0.0, 160.0) as usize);
            let wrong = rng.uniform() < 0.2;
            let width = map.width();
            for index in (0..20 * 20).map(|k| (top + k / 20) * width + left + k % 20) {
                map.depth[index] = if wrong { map.depth[index] * 0.7 } else { 0.0 };
            }
        }
    }
    assert_free_is_free(&scan, &carved(&scan, &maps));
}

/// A surface that was concluded, not seen, hides what is behind it and frees nothing before it.
#[test]
fn what_was_inferred_frees_nothing() {
    let scan = scan(pinhole(120), 5);
    let mut maps = true_maps(&scan);
    for map in &mut maps {
        map.inferred.fill(true);
    }
    assert_eq!(carved(&scan, &maps).count(Occupancy::Free), 0);
}

#[test]
fn one_view_is_no_proof() {
    let scan = scan(pinhole(120), 3);
    let maps = true_maps(&scan);
    let grid = carved(&scan, &maps[..1]);
    assert_eq!(grid.count(Occupancy::Unseen), grid.states().len());
}

#[test]
fn a_grid_needs_a_box() {
    let [low, high] = [0.0, 2.0].map(|v| Point3::new(v, v, v));
    assert!(SpaceCarver::new(low, high, 0.1).is_some());
    for (low, high, voxel) in
        [(high, low, 0.1), (low, high, 0.0), (low, high, f64::NAN), (low, high, 1e-6)]
    {
        assert!(SpaceCarver::new(low, high, voxel).is_none());
    }
}
