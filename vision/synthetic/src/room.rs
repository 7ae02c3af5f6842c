//! A room of flat surfaces: walls, floor, ceiling and boxes that stand in it.

use nalgebra::{Point3, Vector3};

use crate::Rng;

/// A box that stands upright, turned about the vertical.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cuboid {
    /// Its middle.
    pub center: Point3<f64>,
    /// Half of its edges before the turn, meters.
    pub half: Vector3<f64>,
    /// Cosine and sine of its turn about z, counterclockwise seen from above.
    cos_sin: [f64; 2],
}

/// A point of a surface with the direction it faces.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// World.
    pub position: Point3<f64>,
    /// Unit, out of the solid, into the free space.
    pub normal: Vector3<f64>,
}

/// A closed box room with boxes in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Room {
    /// Inner length along x, along y and height, meters.
    pub size: Vector3<f64>,
    /// What stands in it.
    pub furniture: Vec<Cuboid>,
}

/// Parts of a ray's length by which a hit may miss its target and still be the target.
const HIT_SLACK: f64 = 1e-6;

impl Cuboid {
    /// A box around `center`, turned by `turn` radians.
    pub fn new(center: Point3<f64>, half: Vector3<f64>, turn: f64) -> Self {
        Self { center, half, cos_sin: [turn.cos(), turn.sin()] }
    }

    /// A box whose bottom middle is at `(x, y, z)`.
    pub fn standing(x: f64, y: f64, z: f64, size: Vector3<f64>, turn: f64) -> Self {
        let half = size / 2.0;
        Self::new(Point3::new(x, y, z + half.z), half, turn)
    }

    /// A vector of the world in the axes of the box.
    pub fn local(&self, v: &Vector3<f64>) -> Vector3<f64> {
        let [cos, sin] = self.cos_sin;
        Vector3::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x, v.z)
    }

    /// A vector in the axes of the box in the world.
    pub fn world(&self, v: &Vector3<f64>) -> Vector3<f64> {
        let [cos, sin] = self.cos_sin;
        Vector3::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y, v.z)
    }

    /// Range of `s` with `origin + s * ray` inside the box, if the line meets it (slab method).
    pub fn span(&self, origin: &Point3<f64>, ray: &Vector3<f64>) -> Option<(f64, f64)> {
        let o = self.local(&(origin - self.center));
        let d = self.local(ray);
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        for axis in 0..3 {
            let inverse = 1.0 / d[axis];
            let a = (-self.half[axis] - o[axis]) * inverse;
            let b = (self.half[axis] - o[axis]) * inverse;
            // A ray within a slab's plane gives NaN, which min and max pass over.
            enter = enter.max(a.min(b));
            leave = leave.min(a.max(b));
        }
        (enter < leave).then_some((enter, leave))
    }

    /// Whether a point lies inside, grown by `margin` on every side.
    pub fn contains(&self, point: &Point3<f64>, margin: f64) -> bool {
        let p = self.local(&(point - self.center));
        (0..3).all(|axis| p[axis].abs() < self.half[axis] + margin)
    }
}

impl Room {
    /// The room of the yaw-scan measurements: 8 x 6 x 3 m with crates and shelves along the walls.
    /// The middle, to 2 m from the center, is free.
    pub fn standard() -> Self {
        let crate_at =
            |x, y, w, d, h, turn| Cuboid::standing(x, y, 0.0, Vector3::new(w, d, h), turn);
        Self {
            size: Vector3::new(8.0, 6.0, 3.0),
            furniture: vec![
                crate_at(-3.3, -2.3, 0.8, 0.6, 0.9, 0.2),
                crate_at(-3.4, 1.2, 0.6, 1.4, 1.9, 0.0),
                crate_at(-1.2, 2.6, 1.6, 0.5, 1.4, 0.0),
                crate_at(1.6, 2.4, 0.7, 0.7, 0.7, 0.5),
                crate_at(3.3, 1.9, 0.7, 0.9, 1.1, -0.3),
                crate_at(3.5, -0.9, 0.5, 1.8, 2.1, 0.0),
                crate_at(1.9, -2.5, 1.1, 0.6, 0.8, 0.1),
                crate_at(-0.8, -2.55, 1.3, 0.5, 1.7, 0.0),
            ],
        }
    }

    /// Whether a point is in the free space, at least `margin` from every surface.
    pub fn is_free(&self, point: &Point3<f64>, margin: f64) -> bool {
        let half = self.size / 2.0;
        point.x.abs() <= half.x - margin
            && point.y.abs() <= half.y - margin
            && point.z >= margin
            && point.z <= self.size.z - margin
            && self.furniture.iter().all(|cuboid| !cuboid.contains(point, margin))
    }

    /// Whether no furniture stands between two points of the free space or of surfaces.
    pub fn sees(&self, from: &Point3<f64>, to: &Point3<f64>) -> bool {
        let ray = to - from;
        self.furniture.iter().all(|cuboid| {
            cuboid
                .span(from, &ray)
                .is_none_or(|(enter, leave)| leave <= HIT_SLACK || enter >= 1.0 - HIT_SLACK)
        })
    }

    /// Distance of a point to the nearest surface, from either side.
    pub fn distance_to_surface(&self, point: &Point3<f64>) -> f64 {
        let to_box = |cuboid: &Cuboid| {
            let over = cuboid.local(&(point - cuboid.center)).abs() - cuboid.half;
            let outside = over.map(|v| v.max(0.0)).norm();
            if outside > 0.0 { outside } else { -over.max() }
        };
        let shell = self.shell();
        let boxes = std::iter::once(&shell).chain(&self.furniture);
        boxes.map(to_box).fold(f64::INFINITY, f64::min)
    }

    /// A random point of the visible surfaces, uniform by area.
    pub fn surface_point(&self, rng: &mut Rng) -> SurfacePoint {
        loop {
            let mut pick = rng.uniform() * self.area();
            let shell = self.shell();
            let mut found = None;
            for (index, cuboid) in std::iter::once(&shell).chain(&self.furniture).enumerate() {
                let area = box_area(cuboid);
                if pick < area {
                    let inward = if index == 0 { -1.0 } else { 1.0 };
                    found = Some(point_of_box(cuboid, pick, inward, rng));
                    break;
                }
                pick -= area;
            }
            // Faces that stand on the floor or against a wall are not free; draw again.
            if let Some(point) = found
                && self.is_free(&(point.position + point.normal * 1e-3), 0.0)
            {
                return point;
            }
        }
    }

    /// The room itself as a box.
    pub fn shell(&self) -> Cuboid {
        Cuboid::standing(0.0, 0.0, 0.0, self.size, 0.0)
    }

    fn area(&self) -> f64 {
        box_area(&self.shell()) + self.furniture.iter().map(box_area).sum::<f64>()
    }
}

fn box_area(cuboid: &Cuboid) -> f64 {
    let h = &cuboid.half;
    8.0 * (h.y * h.z + h.x * h.z + h.x * h.y)
}

/// Point of the face that `pick` (in 0..area) falls on.
fn point_of_box(cuboid: &Cuboid, mut pick: f64, outward: f64, rng: &mut Rng) -> SurfacePoint {
    let h = cuboid.half;
    let mut axis = 0;
    for (index, area) in [8.0 * h.y * h.z, 8.0 * h.x * h.z, 8.0 * h.x * h.y].into_iter().enumerate()
    {
        axis = index;
        if pick < area {
            break;
        }
        pick -= area;
    }
    let sign = if rng.chance(0.5) { 1.0 } else { -1.0 };
    let mut p = Vector3::from_fn(|i, _| h[i] * rng.range(-1.0, 1.0));
    p[axis] = sign * h[axis];
    let mut n = Vector3::zeros();
    n[axis] = sign * outward;
    SurfacePoint { position: cuboid.center + cuboid.world(&p), normal: cuboid.world(&n) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn surface_points_lie_on_surfaces_and_face_free_space() {
        let room = Room::standard();
        let mut rng = Rng::new(1);
        let mut on_furniture = 0;
        for _ in 0..2000 {
            let SurfacePoint { position, normal } = room.surface_point(&mut rng);
            assert!((normal.norm() - 1.0).abs() < 1e-12);
            assert!(room.is_free(&(position + normal * 1e-3), 0.0));
            assert!(!room.is_free(&(position - normal * 1e-3), 0.0));
            assert!(room.distance_to_surface(&position) < 1e-12);
            for step in [0.01, -0.01] {
                let off = room.distance_to_surface(&(position + normal * step));
                assert!(off <= 0.01 + 1e-12 && off > 0.0, "{off}");
            }
            on_furniture += usize::from(
                room.is_free(&position, -1e-3)
                    && room.furniture.iter().any(|c| c.contains(&position, 1e-6)),
            );
        }
        assert!(on_furniture > 200, "{on_furniture}");
    }

    #[test]
    fn boxes_hide_what_is_behind_them() {
        let size = Vector3::new(1.0, 1.0, 1.0);
        let cuboid = Cuboid::standing(2.0, 0.0, 0.0, size, 0.3);
        let room = Room { size: Vector3::new(8.0, 6.0, 3.0), furniture: vec![cuboid] };
        let eye = Point3::new(0.0, 0.0, 0.5);
        assert!(!room.sees(&eye, &Point3::new(4.0, 0.0, 0.5)));
        assert!(room.sees(&eye, &Point3::new(4.0, 0.0, 2.5)));
        assert!(room.sees(&eye, &Point3::new(1.0, 0.0, 0.5)));
        // The near face is seen, the far one not.
        let (enter, leave) = cuboid.span(&eye, &Vector3::x()).unwrap();
        assert!(room.sees(&eye, &Point3::new(enter, 0.0, 0.5)));
        assert!(!room.sees(&eye, &Point3::new(leave, 0.0, 0.5)));
    }
}
