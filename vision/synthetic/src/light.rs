//! Light in a hall: area lamps with soft shadows and the dimming of corners, computed once per
//! surface on a coarse grid. Light does not depend on the view, so images stay comparable.

use nalgebra::{Point3, Vector3};

use crate::Room;

/// Distance of grid nodes, meters.
const NODE_SPACING: f64 = 0.16;
/// Sample points per lamp edge.
const LAMP_SAMPLES: usize = 2;
/// Light that comes from everywhere, at most.
const AMBIENT: f64 = 0.62;
/// How far corners dim, meters.
const AMBIENT_REACH: f64 = 0.9;

/// A rectangle under the ceiling that shines downward.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lamp {
    pub(crate) center: Point3<f64>,
    pub(crate) half: [f64; 2],
    pub(crate) power: f64,
}

/// Bilinear grid of light over a surface.
pub(crate) struct LightMap {
    columns: usize,
    rows: usize,
    spacing: [f64; 2],
    values: Vec<f32>,
}

impl LightMap {
    /// Light over the surface `origin + x u + y v` with normal `normal`.
    pub(crate) fn new(
        room: &Room,
        lamps: &[Lamp],
        origin: &Point3<f64>,
        axes: [&Vector3<f64>; 2],
        normal: &Vector3<f64>,
        size: [f64; 2],
    ) -> Self {
        let [columns, rows] = size.map(|s| (s / NODE_SPACING).ceil() as usize + 1);
        let spacing = [size[0] / (columns - 1) as f64, size[1] / (rows - 1) as f64];
        let mut values = Vec::with_capacity(columns * rows);
        for row in 0..rows {
            for column in 0..columns {
                // Nodes on the rim are drawn inward: the rim itself touches other surfaces.
                let x = (column as f64 * spacing[0]).clamp(0.01, (size[0] - 0.01).max(0.01));
                let y = (row as f64 * spacing[1]).clamp(0.01, (size[1] - 0.01).max(0.01));
                let node = origin + axes[0] * x + axes[1] * y + normal * 0.01;
                values.push(light_at(room, lamps, &node, normal) as f32);
            }
        }
        Self { columns, rows, spacing, values }
    }

    pub(crate) fn at(&self, x: f64, y: f64) -> f32 {
        let split = |v: f64, spacing: f64, n: usize| {
            let s = (v / spacing).clamp(0.0, (n - 1) as f64);
            let i = (s as usize).min(n - 2);
            (i, (s - i as f64) as f32)
        };
        let (i, fx) = split(x, self.spacing[0], self.columns);
        let (j, fy) = split(y, self.spacing[1], self.rows);
        let value = |di, dj| self.values[(j + dj) * self.columns + i + di];
        let top = value(0, 0) + fx * (value(1, 0) - value(0, 0));
        let bottom = value(0, 1) + fx * (value(1, 1) - value(0, 1));
        top + fy * (bottom - top)
    }
}

fn light_at(room: &Room, lamps: &[Lamp], node: &Point3<f64>, normal: &Vector3<f64>) -> f64 {
    let mut direct = 0.0;
    for lamp in lamps {
        for i in 0..LAMP_SAMPLES * LAMP_SAMPLES {
            let place = |k: usize| (k as f64 + 0.5) / LAMP_SAMPLES as f64 * 2.0 - 1.0;
            let dx = lamp.half[0] * place(i % LAMP_SAMPLES);
            let dy = lamp.half[1] * place(i / LAMP_SAMPLES);
            let to_lamp = lamp.center + Vector3::new(dx, dy, 0.0) - node;
            let distance2 = to_lamp.norm_squared();
            let (cos_here, cos_lamp) = (normal.dot(&to_lamp), to_lamp.z);
            if cos_here > 0.0 && cos_lamp > 0.0 && room.sees(node, &(node + to_lamp)) {
                let samples = (LAMP_SAMPLES * LAMP_SAMPLES) as f64;
                direct += lamp.power * cos_here * cos_lamp / (distance2 * distance2 * samples);
            }
        }
    }
    direct + AMBIENT * openness(room, node, normal)
}

/// How much of the half space over a surface is free, 0..1; what is nearer than
/// [`AMBIENT_REACH`] dims.
fn openness(room: &Room, node: &Point3<f64>, normal: &Vector3<f64>) -> f64 {
    const NUM_RAYS: usize = 9;
    let side = if normal.z.abs() < 0.5 { Vector3::z() } else { Vector3::x() };
    let a = normal.cross(&side).normalize();
    let b = normal.cross(&a);
    let mut open = 0.0;
    for k in 0..NUM_RAYS {
        // Cosine-distributed: one straight up, eight around at 45 degrees.
        let ray = if k == 0 {
            *normal
        } else {
            let (sin, cos) = (std::f64::consts::FRAC_PI_4 * k as f64).sin_cos();
            (normal + a * cos + b * sin).normalize()
        };
        let mut nearest = AMBIENT_REACH;
        for cuboid in &room.furniture {
            if let Some((enter, leave)) = cuboid.span(node, &ray)
                && leave > 0.0
            {
                nearest = nearest.min(enter.max(0.0));
            }
        }
        for axis in 0..3 {
            let bound = match (axis, ray[axis] > 0.0) {
                (2, true) => room.size.z,
                (2, false) => 0.0,
                (_, true) => room.size[axis] / 2.0,
                (_, false) => -room.size[axis] / 2.0,
            };
            let s = (bound - node[axis]) / ray[axis];
            if s > 0.0 {
                nearest = nearest.min(s);
            }
        }
        open += (nearest / AMBIENT_REACH).min(1.0) / NUM_RAYS as f64;
    }
    0.35 + 0.65 * open
}
