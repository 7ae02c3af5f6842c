//! What the surfaces of a hall look like. Every surface is painted from its own seed, so no two
//! are alike; each shows corners and blobs from a centimeter to meters.

use nalgebra::Vector2;

use crate::Rng;
use crate::canvas::{Canvas, Color, Placement, cell_value, text_aspect, word};

/// What a surface is made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Material {
    /// Painted brickwork with posters and scuffs.
    Wall,
    /// Concrete with joints, lines and stains.
    Floor,
    /// Panels with lamps.
    Ceiling,
    /// Cardboard with labels and tape.
    Carton,
    /// Planks with stencils.
    Wood,
    /// Painted steel with holes and stickers.
    Steel,
    /// A bin of colored plastic.
    Plastic,
}

const INK: Color = [0.08, 0.08, 0.1];
const PAPER: Color = [0.93, 0.92, 0.88];

/// Paints `width_m` x `height_m` meters of `material`.
pub(crate) fn paint(
    material: Material,
    width_m: f64,
    height_m: f64,
    texel: f64,
    seed: u64,
) -> Canvas {
    let mut rng = Rng::fork(seed, 0x70);
    let mut canvas = Canvas::new(width_m, height_m, texel, [0.5; 3]);
    let size = Vector2::new(width_m, height_m);
    match material {
        Material::Wall => wall(&mut canvas, size, &mut rng),
        Material::Floor => floor(&mut canvas, size, &mut rng),
        Material::Ceiling => ceiling(&mut canvas, size, &mut rng),
        Material::Carton => carton(&mut canvas, size, &mut rng),
        Material::Wood => wood(&mut canvas, size, &mut rng),
        Material::Steel => steel(&mut canvas, size, &mut rng),
        Material::Plastic => plastic(&mut canvas, size, &mut rng),
    }
    canvas
}

fn wall(canvas: &mut Canvas, size: Vector2<f64>, rng: &mut Rng) {
    const BRICK: [f64; 2] = [0.29, 0.095];
    const MORTAR: f64 = 0.012;
    let (tones, band) = (rng.bits(), size.y - rng.range(1.0, 1.4));
    let upper = tint([0.72, 0.70, 0.66], 0.06, rng);
    let lower = tint([0.42, 0.47, 0.50], 0.06, rng);
    canvas.repaint(|x, y, _| {
        let row = (y / BRICK[1]).floor();
        let shift = if row.rem_euclid(2.0) < 1.0 { 0.0 } else { 0.5 };
        let column = (x / BRICK[0] + shift).floor();
        let (in_x, in_y) = ((x / BRICK[0] + shift - column) * BRICK[0], y - row * BRICK[1]);
        let base = if y < band { upper } else { lower };
        let tone = cell_value(tones, column as i64, row as i64);
        let joint = if in_x < MORTAR || in_y < MORTAR { 0.80 } else { 1.0 };
        base.map(|c| c * (1.0 + 0.11 * tone) * joint)
    });
    canvas.grain(rng.bits(), 0.16, Vector2::new(0.9, 0.9), 7);
    spots(canvas, size, 7.0, [0.008, 0.05], rng);
    stains(canvas, size, 0.5, [0.05, 0.4], rng);
    canvas.line([0.0, band], [size.x, band], 0.035, [0.75, 0.62, 0.15], 0.9);
    pipes(canvas, size, rng);
    for _ in 0..count(size.x * size.y * 0.5, rng) {
        let half = Vector2::new(rng.range(0.12, 0.5), rng.range(0.15, 0.45));
        let at = Vector2::new(rng.range(0.0, size.x), rng.range(0.1, size.y - 0.1));
        poster(canvas, Placement::new(at.x, at.y, 0.05 * rng.normal()), half, rng);
    }
}

fn pipes(canvas: &mut Canvas, size: Vector2<f64>, rng: &mut Rng) {
    for _ in 0..2 {
        let y = rng.range(0.15, 0.4) * size.y;
        let color = tint([0.55, 0.56, 0.58], 0.15, rng);
        canvas.line([0.0, y], [size.x, y], 0.06, color, 0.95);
        canvas.line([0.0, y - 0.02], [size.x, y - 0.02], 0.012, [0.85; 3], 0.7);
        let mut x = rng.range(0.1, 0.9);
        while x < size.x {
            canvas.rect(Placement::new(x, y, 0.0), Vector2::new(0.02, 0.05), INK, 0.8);
            x += rng.range(0.5, 1.4);
        }
    }
}

fn floor(canvas: &mut Canvas, size: Vector2<f64>, rng: &mut Rng) {
    const SLAB: f64 = 2.5;
    let tones = rng.bits();
    let base = tint([0.50, 0.49, 0.47], 0.04, rng);
    canvas.repaint(|x, y, _| {
        let (i, j) = ((x / SLAB).floor(), (y / SLAB).floor());
        let joint = (x - i * SLAB).min(y - j * SLAB);
        let tone = 1.0 + 0.08 * cell_value(tones, i as i64, j as i64);
        base.map(|c| c * tone * if joint < 0.015 { 0.55 } else { 1.0 })
    });
    canvas.grain(rng.bits(), 0.30, Vector2::new(1.6, 1.6), 8);
    spots(canvas, size, 9.0, [0.008, 0.06], rng);
    stains(canvas, size, 0.8, [0.06, 0.5], rng);
    for _ in 0..count(size.x * size.y * 0.25, rng) {
        crack(canvas, size, rng);
    }
    let yellow = [0.82, 0.68, 0.12];
    for inset in [0.22, 0.78] {
        let (x, y) = (inset * size.x, inset * size.y);
        canvas.line([x, 0.1 * size.y], [x, 0.9 * size.y], 0.1, yellow, 0.8);
        canvas.line([0.1 * size.x, y], [0.9 * size.x, y], 0.1, yellow, 0.8);
    }
    for _ in 0..count(size.x * size.y * 0.2, rng) {
        let place =
            Placement::new(rng.range(0.0, size.x), rng.range(0.0, size.y), rng.range(0.0, 6.3));
        let height = rng.range(0.1, 0.35);
        let color = if rng.chance(0.5) { yellow } else { [0.85; 3] };
        canvas.text(place, &word(rng), height, color);
    }
    // Paint wears off.
    canvas.weave(rng.bits(), Vector2::new(0.2, 0.2), 4, |color, noise| {
        let worn = 0.6 * noise.max(0.0);
        std::array::from_fn(|c| color[c] + worn * (base[c] * 0.8 - color[c]))
    });
}

fn ceiling(canvas: &mut Canvas, size: Vector2<f64>, rng: &mut Rng) {
    const PANEL: [f64; 2] = [1.2, 0.6];
    let tones = rng.bits();
    canvas.repaint(|x, y, _| {
        let (i, j) = ((x / PANEL[0]).floor(), (y / PANEL[1]).floor());
        let joint = (x - i * PANEL[0]).min(y - j * PANEL[1]);
        let tone = 0.62 * (1.0 + 0.16 * cell_value(tones, i as i64, j as i64));
        [if joint < 0.02 { 0.45 * tone } else { tone }; 3]
    });
    canvas.grain(rng.bits(), 0.18, Vector2::new(0.7, 0.7), 7);
    spots(canvas, size, 7.0, [0.01, 0.05], rng);
    stains(canvas, size, 0.6, [0.05, 0.35], rng);
    for _ in 0..count(size.x * size.y * 0.12, rng) {
        let (x, y) = (rng.range(0.0, size.x), rng.range(0.0, size.y));
        let half = rng.range(0.12, 0.3);
        let frame = Placement::new(x, y, 0.0);
        canvas.rect(frame, Vector2::new(half, half), [0.35; 3], 1.0);
        for k in -3..=3 {
            let slit = Placement::new(x, y + f64::from(k) * half / 4.0, 0.0);
            canvas.rect(slit, Vector2::new(0.85 * half, half / 14.0), [0.8; 3], 1.0);
        }
    }
}

fn carton(canvas: &mut Canvas, size: Vector2<f64>, rng: &mut Rng) {
    let base = tint([0.64, 0.50, 0.34], 0.12, rng);
    canvas.repaint(|_, y, _| base.map(|c| c * (1.0 + 0.02 * (y * 900.0).sin() as f32)));
    canvas.grain(rng.bits(), 0.20, Vector2::new(0.35, 0.35), 6);
    let tape = tint([0.78, 0.70, 0.52], 0.1, rng);
    let x = size.x * rng.range(0.35, 0.65);
    canvas.line([x, 0.0], [x, size.y], 0.06, tape, 0.75);
    edges(canvas, size, 0.012);
    spots(canvas, size, 25.0, [0.006, 0.03], rng);
    for _ in 0..1 + rng.index(3) {
        let half = Vector2::new(rng.range(0.05, 0.14), rng.range(0.04, 0.1));
        let at = Vector2::new(rng.range(0.1, 0.9) * size.x, rng.range(0.1, 0.9) * size.y);
        label(canvas, Placement::new(at.x, at.y, 0.08 * rng.normal()), half, rng);
    }
    let place = Placement::new(size.x * rng.range(0.03, 0.2), size.y * rng.range(0.1, 0.7), 0.0);
    stencil(canvas, place, rng.range(0.05, 0.11), size, rng);
    if rng.chance(0.6) {
        let place = Placement::new(size.x * rng.range(0.2, 0.9), size.y * rng.range(0.2, 0.8), 0.0);
        canvas.triangle(place, 0.07, [0.7, 0.12, 0.1], 0.9);
        canvas.triangle(place, 0.035, base, 0.9);
    }
}

fn wood(canvas: &mut Canvas, size: Vector2<f64>, rng: &mut Rng) {
    let plank = rng.range(0.09, 0.14);
    let (tones, base) = (rng.bits(), tint([0.60, 0.45, 0.28], 0.12, rng));
    canvas.repaint(|_, y, _| {
        let row = (y / plank).floor();
        let gap = if y - row * plank < 0.01 { 0.35 } else { 1.0 };
        base.map(|c| c * gap * (1.0 + 0.22 * cell_value(tones, row as i64, 0)))
    });
    canvas.grain(rng.bits(), 0.30, Vector2::new(0.6, 0.05), 6);
    spots(canvas, size, 12.0, [0.008, 0.03], rng);
    let mut y = plank / 2.0;
    while y < size.y {
        for x in [0.04, 0.5 * size.x, size.x - 0.04] {
            let x = x + 0.01 * rng.normal();
            canvas.disc(Placement::new(x, y, 0.0), 0.009, 0.0, [0.2; 3], 0.9);
        }
        y += plank;
    }
    edges(canvas, size, 0.02);
    let turn = 0.03 * rng.normal();
    let place = Placement::new(size.x * rng.range(0.04, 0.2), size.y * rng.range(0.15, 0.6), turn);
    stencil(canvas, place, rng.range(0.09, 0.2), size, rng);
    let half = Vector2::new(0.1, 0.07);
    label(canvas, Placement::new(size.x * rng.range(0.2, 0.8), size.y * 0.8, 0.0), half, rng);
}

fn steel(canvas: &mut Canvas, size: Vector2<f64>, rng: &mut Rng) {
    let base = [[0.80, 0.36, 0.10], [0.16, 0.28, 0.52], [0.45, 0.47, 0.48]][rng.index(3)];
    canvas.repaint(|_, _, _| base);
    canvas.grain(rng.bits(), 0.22, Vector2::new(0.3, 0.3), 6);
    let (long, short) = (size.x.max(size.y), size.x.min(size.y));
    let mut s = rng.range(0.03, 0.08);
    while s < long {
        let at = if size.y >= size.x { [short / 2.0, s] } else { [s, short / 2.0] };
        let radius = 0.25 * short.min(0.06);
        canvas.disc(Placement::new(at[0], at[1], 0.0), radius, 0.0, INK, 0.8);
        s += rng.range(0.07, 0.13);
    }
    spots(canvas, size, 40.0, [0.004, 0.02], rng);
    for _ in 0..count(long * 0.8, rng) {
        let half = Vector2::new(0.4 * short.min(0.2), 0.03);
        let place = Placement::new(rng.range(0.0, size.x), rng.range(0.0, size.y), 0.0);
        label(canvas, place, half, rng);
    }
}

fn plastic(canvas: &mut Canvas, size: Vector2<f64>, rng: &mut Rng) {
    let hue = [[0.12, 0.32, 0.60], [0.62, 0.12, 0.12], [0.15, 0.45, 0.25], [0.70, 0.62, 0.15]];
    let base = tint(hue[rng.index(4)], 0.08, rng);
    canvas.repaint(|_, _, _| base);
    canvas.grain(rng.bits(), 0.14, Vector2::new(0.25, 0.25), 6);
    let mut x = 0.05;
    while x < size.x {
        canvas.line([x, 0.05], [x, size.y - 0.04], 0.012, base.map(|c| 0.6 * c), 0.8);
        x += rng.range(0.07, 0.12);
    }
    edges(canvas, size, 0.025);
    spots(canvas, size, 25.0, [0.005, 0.02], rng);
    let half = Vector2::new(0.09_f64.min(0.4 * size.x), 0.05_f64.min(0.4 * size.y));
    label(canvas, Placement::new(size.x / 2.0, size.y / 2.0, 0.0), half, rng);
}

/// A printed sheet: background, figures, lines of text.
fn poster(canvas: &mut Canvas, place: Placement, half: Vector2<f64>, rng: &mut Rng) {
    let paper = if rng.chance(0.5) { PAPER } else { any_color(rng) };
    canvas.rect(place, half + Vector2::new(0.012, 0.012), [0.12; 3], 0.9);
    canvas.rect(place, half, paper, 1.0);
    for _ in 0..3 + rng.index(6) {
        let at = spot_in(place, half * 0.85, rng);
        let radius = half.min() * rng.range(0.08, 0.4);
        let color = any_color(rng);
        match rng.index(4) {
            0 => canvas.disc(at, radius, 0.0, color, 0.9),
            1 => canvas.disc(at, radius, 0.6 * radius, color, 0.95),
            2 => canvas.triangle(at, radius, color, 0.9),
            _ => canvas.rect(at, Vector2::new(radius, radius * rng.range(0.3, 1.0)), color, 0.9),
        }
    }
    let ink = if luma(paper) > 0.45 { INK } else { PAPER };
    let mut y = -0.9 * half.y + 0.05 * half.y * rng.uniform();
    while y < 0.8 * half.y {
        let text = word(rng);
        let height = (rng.range(0.08, 0.3) * half.y).min(1.7 * half.x / text_aspect(&text));
        canvas.text(offset(place, -0.9 * half.x, y), &text, height, ink);
        y += height * rng.range(1.5, 4.0);
    }
}

/// A white label with a bar code and lines of print.
fn label(canvas: &mut Canvas, place: Placement, half: Vector2<f64>, rng: &mut Rng) {
    canvas.rect(place, half, PAPER, 0.97);
    let mut x = -0.85;
    while x < 0.85 {
        let width = rng.range(0.03, 0.12);
        let at = [x * half.x, 0.05 * half.y, width * half.x, 0.8 * half.y];
        canvas.rect_at(place, at, INK, 0.95);
        x += width + rng.range(0.03, 0.12);
    }
    let text = word(rng);
    let height = (0.6 * half.y).min(1.7 * half.x / text_aspect(&text));
    canvas.text(offset(place, -0.85 * half.x, -0.8 * half.y), &text, height, INK);
}

/// A word in ink that ends before the right edge.
fn stencil(canvas: &mut Canvas, place: Placement, height: f64, size: Vector2<f64>, rng: &mut Rng) {
    let text = word(rng);
    let room = 0.96 * size.x - place.origin.x;
    canvas.text(place, &text, height.min(room / text_aspect(&text)), tint(INK, 0.05, rng));
}

/// Small marks: flakes, screws, stickers, `density` per square meter.
fn spots(canvas: &mut Canvas, size: Vector2<f64>, density: f64, radii: [f64; 2], rng: &mut Rng) {
    for _ in 0..count(size.x * size.y * density, rng) {
        let turn = rng.range(0.0, 6.3);
        let place = Placement::new(rng.range(0.0, size.x), rng.range(0.0, size.y), turn);
        // Many small, few large.
        let radius = radii[0] * (radii[1] / radii[0]).powf(rng.uniform().powi(2));
        let color =
            if rng.chance(0.7) { [rng.range(0.05, 0.95) as f32; 3] } else { any_color(rng) };
        let alpha = rng.range(0.4, 0.95) as f32;
        match rng.index(4) {
            0 | 1 => canvas.disc(place, radius, 0.0, color, alpha),
            2 => canvas.triangle(place, radius, color, alpha),
            _ => {
                canvas.rect(place, Vector2::new(radius, radius * rng.range(0.2, 1.0)), color, alpha)
            }
        }
    }
}

fn stains(canvas: &mut Canvas, size: Vector2<f64>, density: f64, radii: [f64; 2], rng: &mut Rng) {
    for _ in 0..count(size.x * size.y * density, rng) {
        let (x, y) = (rng.range(0.0, size.x), rng.range(0.0, size.y));
        let tone = if rng.chance(0.7) { 0.2 } else { 0.85 };
        let alpha = rng.range(0.1, 0.4) as f32;
        canvas.blot(x, y, rng.range(radii[0], radii[1]), [tone; 3], alpha, rng.bits());
    }
}

fn crack(canvas: &mut Canvas, size: Vector2<f64>, rng: &mut Rng) {
    let mut from = [rng.range(0.0, size.x), rng.range(0.0, size.y)];
    let mut angle = rng.range(0.0, 6.3);
    for _ in 0..4 + rng.index(8) {
        angle += 0.6 * rng.normal();
        let length = rng.range(0.05, 0.25);
        let to = [from[0] + length * f64::cos(angle), from[1] + length * f64::sin(angle)];
        canvas.line(from, to, 0.008, [0.15; 3], 0.8);
        from = to;
    }
}

fn edges(canvas: &mut Canvas, size: Vector2<f64>, width: f64) {
    for (from, to) in [
        ([0.0, 0.0], [size.x, 0.0]),
        ([0.0, size.y], [size.x, size.y]),
        ([0.0, 0.0], [0.0, size.y]),
        ([size.x, 0.0], [size.x, size.y]),
    ] {
        canvas.line(from, to, 2.0 * width, [0.15; 3], 0.5);
    }
}

fn count(expected: f64, rng: &mut Rng) -> usize {
    (expected + rng.uniform()) as usize
}

fn tint(base: Color, spread: f64, rng: &mut Rng) -> Color {
    let common = rng.range(-spread, spread);
    base.map(|c| (c + (common + rng.range(-0.3, 0.3) * spread) as f32).clamp(0.02, 0.98))
}

fn any_color(rng: &mut Rng) -> Color {
    std::array::from_fn(|_| rng.range(0.05, 0.95) as f32)
}

fn luma(color: Color) -> f32 {
    0.299 * color[0] + 0.587 * color[1] + 0.114 * color[2]
}

fn offset(place: Placement, x: f64, y: f64) -> Placement {
    let d = Vector2::new(place.cos * x - place.sin * y, place.sin * x + place.cos * y);
    Placement { origin: place.origin + d, ..place }
}

fn spot_in(place: Placement, half: Vector2<f64>, rng: &mut Rng) -> Placement {
    offset(place, rng.range(-half.x, half.x), rng.range(-half.y, half.y))
}
