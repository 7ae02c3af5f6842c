//! A furnished, painted and lit hall, ready to be rendered.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::light::{Lamp, LightMap};
use crate::paint::{Material, paint};
use crate::texture::Texture;
use crate::{Cuboid, Rng, Room};

/// Faces that have less free space than this before them are not seen, meters.
const HIDDEN_GAP: f64 = 0.004;

/// A room with textures on all its surfaces.
#[derive(Debug, Clone)]
pub struct Hall {
    /// Its geometry.
    pub room: Room,
    pub(crate) surfaces: Vec<Surface>,
}

/// A textured rectangle: `origin + x u + y v` for x in 0..width, y in 0..height; seen from the
/// side of `normal`.
#[derive(Debug, Clone)]
pub(crate) struct Surface {
    pub(crate) origin: Point3<f64>,
    pub(crate) u: Vector3<f64>,
    pub(crate) v: Vector3<f64>,
    pub(crate) normal: Vector3<f64>,
    pub(crate) width: f64,
    pub(crate) height: f64,
    pub(crate) texture: Texture,
}

/// A surface before it is painted.
struct Blank {
    origin: Point3<f64>,
    u: Vector3<f64>,
    v: Vector3<f64>,
    normal: Vector3<f64>,
    size: [f64; 2],
    material: Material,
}

impl Hall {
    /// A hall of `size` (length, width, height; at least 6 x 5 x 2.6 m) with racks along two
    /// walls, crates, bins and columns; its middle is free to fly. Texels of `texel` meters.
    pub fn furnished(size: Vector3<f64>, texel: f64, seed: u64) -> Self {
        let mut rng = Rng::fork(seed, 0x68);
        let mut items = Vec::new();
        rack(&mut items, -size.x / 2.0 + 0.4, size.y / 2.0 - 0.55, size.x - 0.8, size.z, &mut rng);
        rack(&mut items, -size.x / 4.0, -size.y / 2.0 + 0.55, 0.55 * size.x, size.z, &mut rng);
        stacks(&mut items, &size, &mut rng);
        beams(&mut items, &size);
        Self::painted(size, items, texel, seed)
    }

    /// The room of the yaw-scan measurements with pictures on it.
    pub fn standard(texel: f64, seed: u64) -> Self {
        let room = Room::standard();
        let kinds = [Material::Wood, Material::Carton, Material::Steel, Material::Plastic];
        let items =
            room.furniture.into_iter().enumerate().map(|(i, c)| (c, kinds[i % 4])).collect();
        Self::painted(room.size, items, texel, seed)
    }

    fn painted(size: Vector3<f64>, items: Vec<(Cuboid, Material)>, texel: f64, seed: u64) -> Self {
        let room = Room { size, furniture: items.iter().map(|(cuboid, _)| *cuboid).collect() };
        let lamps = lamps(&size);
        let mut blanks = Vec::new();
        for face in 0..6 {
            let material = match face {
                4 => Material::Floor,
                5 => Material::Ceiling,
                _ => Material::Wall,
            };
            blanks.push(blank(&room.shell(), face, true, material));
        }
        for (cuboid, material) in &items {
            let faces = (0..6).map(|face| blank(cuboid, face, false, *material));
            blanks.extend(faces.filter(|face| is_seen(&room, face)));
        }
        let surfaces = blanks
            .into_par_iter()
            .enumerate()
            .map(|(index, blank)| {
                finish(&room, &lamps, blank, texel, crate::rng::mix(seed) ^ index as u64)
            })
            .collect();
        Self { room, surfaces }
    }

    /// Number of textured rectangles.
    pub fn num_surfaces(&self) -> usize {
        self.surfaces.len()
    }
}

/// Face `face` of a box (−x, +x, −y, +y, −z, +z), seen from inside or outside.
fn blank(cuboid: &Cuboid, face: usize, from_inside: bool, material: Material) -> Blank {
    let (axis, sign) = (face / 2, if face.is_multiple_of(2) { -1.0 } else { 1.0 });
    let mut out = Vector3::zeros();
    out[axis] = sign;
    let normal = if from_inside { -out } else { out };
    // u to the viewer's right, v down, so that lettering reads.
    let (u, v) = if axis == 2 {
        (Vector3::x(), if normal.z > 0.0 { -Vector3::y() } else { Vector3::y() })
    } else {
        (Vector3::z().cross(&normal), -Vector3::z())
    };
    let half = cuboid.half;
    let extent = |d: &Vector3<f64>| d.abs().dot(&half);
    let corner = out * half[axis] - u * extent(&u) - v * extent(&v);
    Blank {
        origin: cuboid.center + cuboid.world(&corner),
        size: [2.0 * extent(&u), 2.0 * extent(&v)],
        u: cuboid.world(&u),
        v: cuboid.world(&v),
        normal: cuboid.world(&normal),
        material,
    }
}

/// Whether any of a few points of a face has free space before it.
fn is_seen(room: &Room, blank: &Blank) -> bool {
    (0..49).any(|k| {
        let [x, y] = [(k % 7) as f64 / 6.0, (k / 7) as f64 / 6.0].map(|s| 0.02 + 0.96 * s);
        let on = blank.origin + blank.u * (x * blank.size[0]) + blank.v * (y * blank.size[1]);
        room.is_free(&(on + blank.normal * (2.0 * HIDDEN_GAP)), HIDDEN_GAP / 2.0)
    })
}

fn finish(room: &Room, lamps: &[Lamp], blank: Blank, texel: f64, seed: u64) -> Surface {
    let Blank { origin, u, v, normal, size, material } = blank;
    let mut canvas = paint(material, size[0], size[1], texel, seed);
    let light = LightMap::new(room, lamps, &origin, [&u, &v], &normal, size);
    canvas.repaint(|x, y, color| color.map(|c| c * light.at(x, y)));
    if material == Material::Ceiling {
        for lamp in lamps {
            let d = lamp.center - origin;
            let place = crate::canvas::Placement::new(d.dot(&u), d.dot(&v), 0.0);
            let half = nalgebra::Vector2::new(lamp.half[0], lamp.half[1]);
            canvas.rect(place, half * 1.15, [0.30; 3], 1.0);
            canvas.rect(place, half, [0.97, 0.97, 0.93], 1.0);
        }
    }
    // Highlights roll off instead of clipping.
    let shown =
        |c: f32| 255.0 * if c < 0.7 { c } else { 0.7 + 0.3 * (1.0 - (-(c - 0.7) / 0.3).exp()) };
    let colors: Vec<[u8; 3]> =
        canvas.colors.iter().map(|c| c.map(|v| shown(v.max(0.0)).round() as u8)).collect();
    let texture = Texture::new(canvas.width, &colors, canvas.texel);
    Surface { origin, u, v, normal, width: size[0], height: size[1], texture }
}

/// A grid of lamps, about one per 9 square meters.
fn lamps(size: &Vector3<f64>) -> Vec<Lamp> {
    let [nx, ny] = [size.x, size.y].map(|s| (s / 3.0).round().max(1.0) as usize);
    let power = 2.2 * size.x * size.y / (nx * ny) as f64 / 9.0 * (size.z / 3.0).sqrt();
    let place = |i: usize, n: usize, s: f64| s * ((i as f64 + 0.5) / n as f64 - 0.5);
    (0..nx * ny)
        .map(|k| Lamp {
            center: Point3::new(
                place(k % nx, nx, size.x),
                place(k / nx, ny, size.y),
                size.z - 0.005,
            ),
            half: [0.6, 0.15],
            power,
        })
        .collect()
}

/// A pallet rack from `x`, `length` along x, its middle at `y`, loaded with cartons and bins.
fn rack(
    items: &mut Vec<(Cuboid, Material)>,
    x: f64,
    y: f64,
    length: f64,
    ceiling: f64,
    rng: &mut Rng,
) {
    const DEPTH: f64 = 0.9;
    const LEVEL: f64 = 1.05;
    let bays = (length / 2.4).round().max(1.0) as usize;
    let bay = length / bays as f64;
    let levels = ((ceiling - 0.9) / LEVEL) as usize;
    let mut put = |x: f64, y: f64, z: f64, size: [f64; 3], turn: f64, material| {
        items.push((Cuboid::standing(x, y, z, Vector3::from(size), turn), material));
    };
    let post_height = 0.12 + LEVEL * levels as f64 - 0.35;
    for post in 0..=bays {
        for side in [-0.5, 0.5] {
            let at = x + bay * post as f64;
            put(
                at,
                y + side * (DEPTH - 0.08),
                0.0,
                [0.08, 0.08, post_height],
                0.0,
                Material::Steel,
            );
        }
    }
    for bay_index in 0..bays {
        let left = x + bay * bay_index as f64 + 0.06;
        for level in 0..levels {
            let z = 0.12 + LEVEL * level as f64;
            put(
                left + bay / 2.0 - 0.06,
                y,
                z - 0.08,
                [bay - 0.10, DEPTH - 0.02, 0.08],
                0.0,
                Material::Steel,
            );
            let mut at = left + 0.05;
            loop {
                let width = rng.range(0.35, 0.8);
                if at + width > left + bay - 0.2 {
                    break;
                }
                let size = [width, rng.range(0.45, 0.75), rng.range(0.3, LEVEL - 0.25)];
                let material = match rng.index(5) {
                    0 => Material::Plastic,
                    1 => Material::Wood,
                    _ => Material::Carton,
                };
                let turn = 0.06 * rng.normal().clamp(-1.5, 1.5);
                put(at + width / 2.0, y + 0.03 * rng.normal(), z, size, turn, material);
                at += width + rng.range(0.08, 0.35);
            }
        }
    }
}

/// Crates, bins and columns along the short walls and the free part of the long one.
fn stacks(items: &mut Vec<(Cuboid, Material)>, size: &Vector3<f64>, rng: &mut Rng) {
    for side in [-1.0, 1.0] {
        let mut y = -size.y / 2.0 + 1.9;
        while y < size.y / 2.0 - 1.9 {
            let x = side * (size.x / 2.0 - rng.range(0.55, 0.85));
            let turn = rng.range(-0.4, 0.4);
            let base = Vector3::new(rng.range(0.5, 0.8), rng.range(0.5, 0.8), rng.range(0.4, 0.9));
            items.push((Cuboid::standing(x, y, 0.0, base, turn), Material::Wood));
            if rng.chance(0.7) {
                let top =
                    Vector3::new(rng.range(0.3, 0.5), rng.range(0.3, 0.5), rng.range(0.25, 0.5));
                let turn = turn + rng.range(-0.5, 0.5);
                let kind = if rng.chance(0.6) { Material::Carton } else { Material::Plastic };
                items.push((Cuboid::standing(x, y, base.z, top, turn), kind));
            }
            y += rng.range(1.1, 1.6);
        }
    }
    // Columns stand where the racks leave off.
    for (x, y) in [(-0.38, -0.40), (0.40, -0.38)] {
        let column = Vector3::new(0.25, 0.25, size.z);
        items.push((Cuboid::standing(x * size.x, y * size.y, 0.0, column, 0.0), Material::Steel));
    }
}

/// Steel beams under the ceiling.
fn beams(items: &mut Vec<(Cuboid, Material)>, size: &Vector3<f64>) {
    let num_beams = (size.x / 3.0).round().max(1.0) as usize;
    for i in 0..=num_beams {
        let x = size.x * (i as f64 / num_beams as f64 - 0.5) * 0.97;
        let beam = Vector3::new(0.14, size.y, 0.22);
        items.push((Cuboid::standing(x, 0.0, size.z - 0.22, beam, 0.0), Material::Steel));
    }
}
