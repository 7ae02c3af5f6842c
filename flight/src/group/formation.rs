//! Places of a group in good order.

use std::f64::consts::PI;

use nalgebra::{Point3, Rotation2, Vector2, Vector3};

use crate::motion::Goal;

/// Order of a group. Neighbors are `spacing` apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Formation {
    /// Side by side.
    Line,
    /// One behind the other.
    Column,
    /// Rows as wide as deep.
    Grid,
    /// Around the center, everybody looking outward.
    Circle,
    /// One ahead, the others behind to both sides.
    Wedge,
}

impl Formation {
    /// Goals of `count` vehicles around `center`, the front of the formation looking along `yaw`.
    pub fn goals(self, count: usize, center: &Point3<f64>, yaw: f64, spacing: f64) -> Vec<Goal> {
        let places: Vec<Vector2<f64>> =
            (0..count).map(|k| self.place(k, count) * spacing).collect();
        let mean = places.iter().sum::<Vector2<f64>>() / count.max(1) as f64;
        let goal = |place: Vector2<f64>| {
            let offset = Rotation2::new(yaw) * (place - mean);
            let outward = yaw + place.y.atan2(place.x);
            Goal {
                position: center + Vector3::new(offset.x, offset.y, 0.0),
                yaw: Some(if self == Self::Circle && count > 1 { outward } else { yaw }),
            }
        };
        places.into_iter().map(goal).collect()
    }

    /// Place of one member, x ahead and y left, in units of the spacing.
    fn place(self, member: usize, count: usize) -> Vector2<f64> {
        let k = member as f64;
        match self {
            Self::Line => Vector2::new(0.0, -k),
            Self::Column => Vector2::new(-k, 0.0),
            Self::Grid => {
                let width = (count as f64).sqrt().ceil() as usize;
                Vector2::new(-((member / width) as f64), -((member % width) as f64))
            }
            Self::Circle if count < 2 => Vector2::zeros(),
            Self::Circle => {
                // A chord of one spacing spans 2 π / n.
                let radius = 0.5 / (PI / count as f64).sin();
                let (sin, cos) = (2.0 * PI * k / count as f64).sin_cos();
                Vector2::new(cos, sin) * radius
            }
            Self::Wedge => {
                let rank = member.div_ceil(2) as f64;
                let side = if member.is_multiple_of(2) { 1.0 } else { -1.0 };
                Vector2::new(-rank, side * rank) * 0.5f64.sqrt()
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    const ALL: [Formation; 5] =
        [Formation::Line, Formation::Column, Formation::Grid, Formation::Circle, Formation::Wedge];

    /// Nobody is nearer than the spacing, everybody has a neighbor at it, and the group is where
    /// it was asked to be, level.
    #[test]
    fn neighbors_are_one_spacing_apart() {
        let center = Point3::new(2.0, -1.0, 1.5);
        for formation in ALL {
            for count in 1..=17 {
                let goals = formation.goals(count, &center, 0.7, 1.3);
                assert_eq!(goals.len(), count);
                let mean =
                    goals.iter().map(|g| g.position.coords).sum::<Vector3<f64>>() / count as f64;
                assert_relative_eq!(mean, center.coords, epsilon = 1e-9);
                assert!(goals.iter().all(|g| (g.position.z - 1.5).abs() < 1e-12));
                for (i, goal) in goals.iter().enumerate().filter(|_| count > 1) {
                    let others = goals.iter().enumerate().filter(|(j, _)| *j != i);
                    let nearest = others
                        .map(|(_, other)| (other.position - goal.position).norm())
                        .fold(f64::INFINITY, f64::min);
                    assert_relative_eq!(nearest, 1.3, epsilon = 1e-9);
                }
            }
        }
    }

    /// Turning the formation turns it about its center.
    #[test]
    fn the_front_follows_the_yaw() {
        let center = Point3::new(0.5, 0.25, 1.0);
        for formation in ALL {
            let straight = formation.goals(7, &center, 0.0, 1.0);
            let turned = formation.goals(7, &center, 1.1, 1.0);
            for (a, b) in straight.iter().zip(&turned) {
                let offset = Rotation2::new(1.1) * (a.position - center).xy();
                assert_relative_eq!((b.position - center).xy(), offset, epsilon = 1e-12);
            }
        }
        let wedge = Formation::Wedge.goals(5, &center, 0.0, 1.0);
        assert!(wedge[1..].iter().all(|g| g.position.x < wedge[0].position.x), "one is ahead");
        let line = Formation::Line.goals(2, &center, 0.0, 1.0);
        assert_eq!(line[0].position.x, line[1].position.x);
    }
}
