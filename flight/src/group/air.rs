//! What is known of the air in a map.

use std::sync::Arc;

use nalgebra::Point3;
use volery_scene::{Occupancy, OccupancyGrid};

use crate::motion::Segment;

/// Where in a map there is room for a vehicle.
#[derive(Debug, Clone, PartialEq)]
pub struct Air {
    grid: Arc<OccupancyGrid>,
    radius: f64,
    unseen: bool,
}

/// A place on a way where there is no room.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Obstruction {
    /// What is there: something, or what nobody has seen.
    pub occupancy: Occupancy,
    /// When the way leads there. Seconds.
    pub at: f64,
    /// Where.
    pub place: Point3<f64>,
}

impl Air {
    /// Room for vehicles of `radius` meters; `unseen` space counts as room or not.
    pub fn new(grid: Arc<OccupancyGrid>, radius: f64, unseen: bool) -> Self {
        Self { grid, radius, unseen }
    }

    /// The first place on the pieces of a way where there is no room.
    ///
    /// Places are looked at so closely, and the vehicle is taken so much larger, that nothing lies
    /// between them.
    pub(crate) fn obstruction<'a>(
        &self,
        pieces: impl IntoIterator<Item = &'a Segment>,
    ) -> Option<Obstruction> {
        let step = self.grid.voxel().max(self.radius) / 3.0;
        pieces.into_iter().find_map(|piece| {
            let speeds = [0.0, piece.duration].map(|t| piece.velocity_at(t).norm());
            let fastest = speeds[0].max(speeds[1]);
            let count = (fastest * piece.duration / step).ceil().max(1.0);
            (0..=count as usize).find_map(|k| {
                let t = piece.duration * k as f64 / count;
                let place = piece.position_at(t);
                let occupancy = self.grid.worst_within(&place, self.radius + 0.5 * step);
                let room = match occupancy {
                    Occupancy::Free => true,
                    Occupancy::Unseen => self.unseen,
                    Occupancy::Occupied => false,
                };
                (!room).then_some(Obstruction { occupancy, at: piece.start + t, place })
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry3;

    use super::*;
    use crate::motion::{LegKind, MotionLimits, Trajectory, Waypoint};

    /// A hall of 10 m by 10 m by 3 m with a pillar of one voxel in its middle, and a corner where
    /// nobody looked.
    fn hall(unseen: bool) -> Air {
        let mut grid = OccupancyGrid::unseen(Isometry3::identity(), 0.1, [100, 100, 30]).unwrap();
        grid.states_mut().fill(Occupancy::Free);
        let centers: Vec<Point3<f64>> = (0..300_000).map(|index| grid.center(index)).collect();
        for (state, center) in grid.states_mut().iter_mut().zip(centers) {
            if (center.x - 5.05).abs() < 0.04 && (center.y - 5.05).abs() < 0.04 {
                *state = Occupancy::Occupied;
            } else if center.x > 8.0 && center.y > 8.0 {
                *state = Occupancy::Unseen;
            }
        }
        Air::new(Arc::new(grid), 0.3, unseen)
    }

    fn way(from: [f64; 3], to: [f64; 3]) -> Trajectory {
        let mut way = Trajectory::standing(Waypoint { position: from.into(), yaw: 0.0 });
        let to = Waypoint { position: to.into(), yaw: 0.0 };
        way.fly(LegKind::Straight, to, &MotionLimits::default());
        way
    }

    /// A pillar is met a radius before it, whatever way leads there, and passed where there is room.
    #[test]
    fn a_pillar_is_not_flown_through() {
        let air = hall(false);
        for height in [0.6, 1.5, 2.3] {
            let met = air.obstruction(way([1.0, 5.05, height], [7.0, 5.05, height]).segments());
            let Obstruction { occupancy, place, at } = met.unwrap();
            assert_eq!(occupancy, Occupancy::Occupied);
            assert!((4.64..4.76).contains(&place.x) && at > 1.0, "{place} {at}");
        }
        for (aside, clear) in [(0.2, false), (0.34, false), (0.6, true)] {
            let way = way([1.0, 5.05 + aside, 1.5], [7.0, 5.05 + aside, 1.5]);
            assert_eq!(air.obstruction(way.segments()).is_none(), clear, "{aside}");
        }
    }

    #[test]
    fn what_nobody_saw_is_no_room_unless_that_is_asked_for() {
        let way = way([6.0, 9.0, 1.5], [9.0, 9.0, 1.5]);
        let met = hall(false).obstruction(way.segments()).unwrap();
        assert_eq!(met.occupancy, Occupancy::Unseen);
        assert!((7.64..7.76).contains(&met.place.x), "{}", met.place);
        assert_eq!(hall(true).obstruction(way.segments()), None);
        let out = self::way([6.0, 9.0, 1.5], [6.0, 9.0, 4.0]);
        assert!(hall(false).obstruction(out.segments()).is_some(), "above the grid");
    }
}
