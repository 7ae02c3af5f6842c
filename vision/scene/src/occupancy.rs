//! Where there is air, where there is something, and where nobody looked.

use nalgebra::{Isometry3, Point3, Similarity3, Vector3};

/// What is known of a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash)]
pub enum Occupancy {
    /// No camera saw it; there may be anything.
    #[default]
    Unseen,
    /// A camera saw through it.
    Free,
    /// A surface is in it.
    Occupied,
}

impl Occupancy {
    /// All states in the order of their codes.
    pub const ALL: [Self; 3] = [Self::Unseen, Self::Free, Self::Occupied];

    /// 0 unseen, 1 free, 2 occupied.
    pub fn code(self) -> u8 {
        self as u8
    }

    /// The inverse of [`Self::code`].
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }
}

/// A box of cubes, each free, occupied or unseen; everything outside of it is unseen.
///
/// The axes of the grid need not be those of the map: a map that is moved takes its grid along.
#[derive(Debug, Clone, PartialEq)]
pub struct OccupancyGrid {
    map_from_grid: Isometry3<f64>,
    voxel: f64,
    size: [usize; 3],
    /// x first, then y, then z.
    states: Vec<Occupancy>,
}

impl OccupancyGrid {
    /// A grid in which nothing is seen yet: `size` voxels of edge `voxel` along x, y and z, the first
    /// of which has its least corner in the origin of the grid frame.
    ///
    /// `None` unless the edge is positive and finite and the voxels can be counted.
    pub fn unseen(map_from_grid: Isometry3<f64>, voxel: f64, size: [usize; 3]) -> Option<Self> {
        let num = size.iter().try_fold(1_usize, |num, &side| num.checked_mul(side))?;
        let sound = voxel.is_finite() && voxel > 0.0;
        let states = sound.then(|| vec![Occupancy::Unseen; num])?;
        Some(Self { map_from_grid, voxel, size, states })
    }

    /// Pose of the grid: its origin is the least corner of the first voxel.
    pub fn map_from_grid(&self) -> &Isometry3<f64> {
        &self.map_from_grid
    }

    /// Edge of a voxel, in units of the map.
    pub fn voxel(&self) -> f64 {
        self.voxel
    }

    /// Voxels along x, y and z of the grid.
    pub fn size(&self) -> [usize; 3] {
        self.size
    }

    /// States of all voxels: x first, then y, then z.
    pub fn states(&self) -> &[Occupancy] {
        &self.states
    }

    /// The same, to be filled in.
    pub fn states_mut(&mut self) -> &mut [Occupancy] {
        &mut self.states
    }

    /// What is known of a point in the map.
    pub fn state_at(&self, point_in_map: &Point3<f64>) -> Occupancy {
        let at = self.in_voxels(point_in_map).coords.map(f64::floor);
        self.state([at.x, at.y, at.z])
    }

    /// The worst that is known of the voxels that a ball touches: occupied if any is, else unseen if
    /// any is or if the ball leaves the grid, else free.
    pub fn worst_within(&self, center_in_map: &Point3<f64>, radius: f64) -> Occupancy {
        let center = self.in_voxels(center_in_map);
        let reach = radius.max(0.0) / self.voxel;
        if !(radius.is_finite() && center.coords.iter().all(|v| v.is_finite())) {
            return Occupancy::Unseen;
        }
        let [low, high] = [-reach, reach].map(|by| center.coords.add_scalar(by).map(f64::floor));
        let outside = (0..3).any(|k| low[k] < 0.0 || high[k] >= self.size[k] as f64);
        let mut worst = if outside { Occupancy::Unseen } else { Occupancy::Free };
        let range = |k: usize| {
            let first = low[k].max(0.0) as usize;
            first..(high[k] + 1.0).clamp(0.0, self.size[k] as f64) as usize
        };
        for z in range(2) {
            for y in range(1) {
                for x in range(0) {
                    let corner = Vector3::new(x as f64, y as f64, z as f64);
                    let nearest = center.coords.sup(&corner).inf(&corner.add_scalar(1.0));
                    if (nearest - center.coords).norm() > reach {
                        continue;
                    }
                    match self.states[(z * self.size[1] + y) * self.size[0] + x] {
                        Occupancy::Occupied => return Occupancy::Occupied,
                        Occupancy::Unseen => worst = Occupancy::Unseen,
                        Occupancy::Free => {}
                    }
                }
            }
        }
        worst
    }

    /// Center of the voxel at an index of [`Self::states`], in the map.
    pub fn center(&self, index: usize) -> Point3<f64> {
        let [nx, ny, _] = self.size.map(|side| side.max(1));
        let cell = [index % nx, index / nx % ny, index / (nx * ny)];
        let [x, y, z] = cell.map(|k| (k as f64 + 0.5) * self.voxel);
        self.map_from_grid * Point3::new(x, y, z)
    }

    /// Number of voxels in a state.
    pub fn count(&self, state: Occupancy) -> usize {
        self.states.iter().filter(|&&other| other == state).count()
    }

    /// The grid of the moved map. `None` if it is too small or too large for numbers.
    pub fn moved(self, moved_from_map: &Similarity3<f64>) -> Option<Self> {
        let voxel = self.voxel * moved_from_map.scaling();
        let origin = moved_from_map * Point3::from(self.map_from_grid.translation.vector);
        let rotation = moved_from_map.isometry.rotation * self.map_from_grid.rotation;
        let map_from_grid = Isometry3::from_parts(origin.into(), rotation);
        let sound = voxel.is_finite() && voxel > 0.0;
        sound.then_some(Self { map_from_grid, voxel, ..self })
    }

    fn in_voxels(&self, point_in_map: &Point3<f64>) -> Point3<f64> {
        self.map_from_grid.inverse_transform_point(point_in_map) / self.voxel
    }

    fn state(&self, at: [f64; 3]) -> Occupancy {
        let inside = (0..3).all(|k| at[k] >= 0.0 && at[k] < self.size[k] as f64);
        if !inside {
            return Occupancy::Unseen;
        }
        let [x, y, z] = at.map(|v| v as usize);
        self.states[(z * self.size[1] + y) * self.size[0] + x]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four by three by two voxels of half a meter, turned by 90 degrees about z and put aside.
    fn grid() -> OccupancyGrid {
        let turn = Vector3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2);
        let pose = Isometry3::new(Vector3::new(10.0, 20.0, 1.0), turn);
        OccupancyGrid::unseen(pose, 0.5, [4, 3, 2]).unwrap()
    }

    #[test]
    fn every_voxel_is_found_at_its_center() {
        let mut grid = grid();
        for index in 0..grid.states().len() {
            let state = Occupancy::ALL[index % 3];
            grid.states_mut()[index] = state;
            assert_eq!(grid.state_at(&grid.center(index)), state);
        }
        assert_eq!(Occupancy::ALL.map(|state| grid.count(state)), [8; 3]);
        // The x of the grid is the y of the map.
        assert!((grid.center(3) - Point3::new(9.75, 21.75, 1.25)).norm() < 1e-12);
    }

    #[test]
    fn nothing_is_known_outside() {
        let mut grid = grid();
        grid.states_mut().fill(Occupancy::Free);
        for outside in
            [[10.1, 20.5, 1.2], [9.9, 19.9, 1.2], [9.9, 20.5, 2.1], [f64::NAN, 20.5, 1.2]]
        {
            assert_eq!(grid.state_at(&Point3::from(outside)), Occupancy::Unseen);
            assert_eq!(grid.worst_within(&Point3::from(outside), 0.0), Occupancy::Unseen);
        }
        assert_eq!(grid.state_at(&Point3::new(9.9, 20.5, 1.2)), Occupancy::Free);
        // A ball that looks out of the grid.
        assert_eq!(grid.worst_within(&Point3::new(9.9, 20.5, 1.5), 0.05), Occupancy::Free);
        assert_eq!(grid.worst_within(&Point3::new(9.9, 20.5, 1.5), 0.2), Occupancy::Unseen);
    }

    /// Against a ball made of many points.
    #[test]
    fn a_ball_is_as_bad_as_the_worst_it_touches() {
        let mut grid = OccupancyGrid::unseen(Isometry3::identity(), 0.25, [12; 3]).unwrap();
        grid.states_mut().fill(Occupancy::Free);
        let center = |at: [f64; 3]| Point3::from(at);
        let wall = 6 + 12 * (6 + 12 * 6);
        grid.states_mut()[wall] = Occupancy::Occupied;
        // Its least corner is at (1.5, 1.5, 1.5).
        for (at, radius, state) in [
            ([1.3, 1.6, 1.6], 0.19, Occupancy::Free),
            ([1.3, 1.6, 1.6], 0.21, Occupancy::Occupied),
            ([1.3, 1.3, 1.3], 0.34, Occupancy::Free),
            ([1.3, 1.3, 1.3], 0.35, Occupancy::Occupied),
            ([1.6, 1.6, 1.6], 0.0, Occupancy::Occupied),
        ] {
            assert_eq!(grid.worst_within(&center(at), radius), state, "{at:?} {radius}");
        }
        grid.states_mut()[0] = Occupancy::Unseen;
        assert_eq!(grid.worst_within(&center([0.3, 0.3, 0.3]), 0.1), Occupancy::Unseen);
        assert_eq!(grid.worst_within(&center([1.0, 1.0, 1.0]), f64::NAN), Occupancy::Unseen);
    }

    #[test]
    fn a_moved_map_takes_its_grid_along() {
        let mut grid = grid();
        grid.states_mut()[17] = Occupancy::Occupied;
        let turn = Vector3::new(0.2, -0.3, 0.4);
        let motion = Similarity3::new(Vector3::new(1.0, -2.0, 3.0), turn, 2.5);
        let moved = grid.clone().moved(&motion).unwrap();
        for index in 0..grid.states().len() {
            let center = motion * grid.center(index);
            assert!((moved.center(index) - center).norm() < 1e-9);
            assert_eq!(moved.state_at(&center), grid.states()[index]);
        }
    }

    #[test]
    fn no_grid_has_impossible_voxels() {
        let pose = Isometry3::identity();
        assert_eq!(OccupancyGrid::unseen(pose, f64::NAN, [1; 3]), None);
        assert_eq!(OccupancyGrid::unseen(pose, 1.0, [usize::MAX, 2, 1]), None);
    }
}
