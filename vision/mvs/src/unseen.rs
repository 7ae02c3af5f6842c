//! Where known free space ends without a surface: what another flight should look at (P99).

use nalgebra::{Point3, Vector3};
use volery_scene::{Occupancy, OccupancyGrid};

/// Voxels around an occupied one that belong to its surface: nothing is seen through the last voxel
/// before a wall.
const SURFACE_REACH: usize = 2;
/// Faces between free and unseen voxels of an area that is worth telling.
const MIN_FACES: usize = 12;

/// A part of the border between free space and what nobody saw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UnseenArea {
    /// Middle of its voxels, in the map.
    pub center: Point3<f64>,
    /// Sides of the box around its voxels, along the axes of the grid.
    pub size: Vector3<f64>,
    /// Of the border, in square units of the map.
    pub area: f64,
}

/// The connected borders between free and unseen voxels, the largest first, at most `max`.
///
/// Source: Yamauchi, "A Frontier-Based Approach for Autonomous Exploration", CIRA 1997.
pub fn unseen_areas(grid: &OccupancyGrid, max: usize) -> Vec<UnseenArea> {
    let [nx, ny, nz] = grid.size();
    let near_surface = near_occupied(grid);
    let free_faces: Vec<u8> = (0..grid.states().len())
        .map(|index| {
            if grid.states()[index] != Occupancy::Unseen || near_surface[index] {
                return 0;
            }
            let is_free = |&other: &usize| grid.states()[other] == Occupancy::Free;
            around(index, [nx, ny, nz], false).filter(is_free).count() as u8
        })
        .collect();
    let mut visited = vec![false; free_faces.len()];
    let mut areas = Vec::new();
    let mut part = Vec::new();
    for start in 0..free_faces.len() {
        if free_faces[start] == 0 || visited[start] {
            continue;
        }
        visited[start] = true;
        part.clear();
        part.push(start);
        let mut next = 0;
        while let Some(&index) = part.get(next) {
            next += 1;
            for other in around(index, [nx, ny, nz], true) {
                if free_faces[other] > 0 && !visited[other] {
                    visited[other] = true;
                    part.push(other);
                }
            }
        }
        let num_faces: usize = part.iter().map(|&index| usize::from(free_faces[index])).sum();
        if num_faces >= MIN_FACES {
            areas.push(area(grid, &part, num_faces));
        }
    }
    areas.sort_by(|a, b| b.area.total_cmp(&a.area));
    areas.truncate(max);
    areas
}

fn area(grid: &OccupancyGrid, part: &[usize], num_faces: usize) -> UnseenArea {
    let [nx, ny, _] = grid.size();
    let cell = |index: usize| Vector3::new(index % nx, index / nx % ny, index / (nx * ny));
    let cells = || part.iter().map(|&index| cell(index).map(|k| k as f64));
    let (low, high) = cells().fold(
        (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY)),
        |(low, high), cell| (low.inf(&cell), high.sup(&cell)),
    );
    let sum: Vector3<f64> = part.iter().map(|&index| grid.center(index).coords).sum();
    UnseenArea {
        center: Point3::from(sum / part.len() as f64),
        size: (high - low).add_scalar(1.0) * grid.voxel(),
        area: num_faces as f64 * grid.voxel() * grid.voxel(),
    }
}

/// Neighbors of a voxel across its faces, or also across its edges and corners.
fn around(
    index: usize,
    [nx, ny, nz]: [usize; 3],
    with_corners: bool,
) -> impl Iterator<Item = usize> {
    let [x, y, z] = [index % nx, index / nx % ny, index / (nx * ny)];
    let steps = (0..27_usize).map(|k| [k % 3, k / 3 % 3, k / 9].map(|s| s as isize - 1));
    steps.filter_map(move |[dx, dy, dz]| {
        let distance = dx.abs() + dy.abs() + dz.abs();
        let wanted = distance == 1 || (with_corners && distance > 1);
        // What is less than zero wraps to more than any size.
        let [x, y, z] = [(x, dx), (y, dy), (z, dz)].map(|(at, step)| at.wrapping_add_signed(step));
        (wanted && x < nx && y < ny && z < nz).then(|| (z * ny + y) * nx + x)
    })
}

/// Whether there is an occupied voxel within [`SURFACE_REACH`] steps along every axis.
fn near_occupied(grid: &OccupancyGrid) -> Vec<bool> {
    let [nx, ny, nz] = grid.size();
    let mut near: Vec<bool> =
        grid.states().iter().map(|&state| state == Occupancy::Occupied).collect();
    for (stride, side) in [(1, nx), (nx, ny), (nx * ny, nz)] {
        let before = near.clone();
        for (index, near) in near.iter_mut().enumerate() {
            let at = index / stride % side;
            let (first, last) =
                (at.saturating_sub(SURFACE_REACH), (at + SURFACE_REACH).min(side - 1));
            *near = (first..=last).any(|other| before[index - at * stride + other * stride]);
        }
    }
    near
}

#[cfg(test)]
mod tests {
    use volery_geometry::Isometry3;

    use super::*;

    /// Free space of 20³ voxels in a shell, with a hole of 4 x 6 voxels in the wall at high x.
    fn room() -> OccupancyGrid {
        let pose = Isometry3::translation(-1.0, 0.0, 2.0);
        let mut grid = OccupancyGrid::unseen(pose, 0.1, [26; 3]).unwrap();
        for index in 0..26 * 26 * 26 {
            let cell = [index % 26, index / 26 % 26, index / 676];
            let inner = |margin: usize| cell.iter().all(|k| (margin..26 - margin).contains(k));
            let is_hole =
                cell[0] >= 22 && (10..14).contains(&cell[1]) && (8..14).contains(&cell[2]);
            grid.states_mut()[index] = match (inner(4), inner(3)) {
                (true, _) => Occupancy::Free,
                (false, true) if is_hole => Occupancy::Unseen,
                (false, true) => Occupancy::Occupied,
                _ => Occupancy::Unseen,
            };
        }
        grid
    }

    /// The middle of a hole is told, not its rim, which may be the wall's.
    #[test]
    fn a_hole_in_a_wall_is_an_unseen_area() {
        let mut grid = room();
        assert_eq!(unseen_areas(&grid, 5), []);
        // Twice as wide: 12 x 12.
        for index in 0..26 * 26 * 26 {
            let [x, y, z] = [index % 26, index / 26 % 26, index / 676];
            if x >= 22 && (6..18).contains(&y) && (6..18).contains(&z) {
                grid.states_mut()[index] = Occupancy::Unseen;
            }
        }
        let areas = unseen_areas(&grid, 5);
        let [hole] = areas[..] else { panic!("{areas:?}") };
        assert!((hole.center - Point3::new(1.25, 1.2, 3.2)).norm() < 1e-9, "{}", hole.center);
        assert!((hole.size - Vector3::new(0.1, 0.8, 0.8)).norm() < 1e-9, "{}", hole.size);
        assert!((hole.area - 0.64).abs() < 1e-9);
    }

    #[test]
    fn the_largest_come_first() {
        let mut grid = OccupancyGrid::unseen(Isometry3::identity(), 1.0, [40, 12, 12]).unwrap();
        for index in 0..40 * 144 {
            let [x, y, z] = [index % 40, index / 40 % 12, index / 480];
            let small = (3..5).contains(&x) && (3..5).contains(&y) && (3..5).contains(&z);
            let large = (15..30).contains(&x) && (2..10).contains(&y) && (2..10).contains(&z);
            if small || large {
                grid.states_mut()[index] = Occupancy::Free;
            }
        }
        let areas = unseen_areas(&grid, 5);
        assert_eq!(areas.len(), 2);
        assert_eq!((areas[0].area, areas[1].area), (608.0, 24.0));
        assert_eq!(unseen_areas(&grid, 1), areas[..1]);
        let nothing = OccupancyGrid::unseen(Isometry3::identity(), 1.0, [3, 0, 2]).unwrap();
        assert_eq!(unseen_areas(&nothing, 5), []);
    }
}
