//! Colors on both sides of a seam are made alike.

use nalgebra::{Vector2, Vector3};
use rayon::prelude::*;
use volery_scene::TriangleMesh;

use super::charts::Chart;
use super::packing::Layout;
use super::paint::{Canvas, Texel, texels};
use crate::fans::{Fans, for_each_edge};

/// Samples along an edge between charts.
const NUM_SAMPLES: u32 = 4;
/// How much a change of the correction within a chart costs, against a difference that is left at a
/// seam.
const STIFFNESS: f64 = 2.0;
/// Holds the corrections near zero where nothing else does.
const HOLD: f64 = 1e-4;
/// Differences much larger than this are not of the light: the surface is not where the two images
/// see it. Logarithms.
const PLAIN_DIFFERENCE: f64 = 0.3;
/// Added to a color before its logarithm is taken, so that dark noise counts little.
const DARK: f64 = 16.0;
/// Steps of the conjugate gradients.
const MAX_STEPS: usize = 300;
/// They end when what is left is so small, relative to the start.
const TOLERANCE: f64 = 1e-3;

type Color = Vector3<f64>;

/// Adds a smooth correction to every chart so that the colors at the seams agree.
///
/// Minimizes over a correction g per vertex of a chart, linear over its triangles,
///
/// ```text
/// Σ w ‖f₁ + g₁ − f₂ − g₂‖² over samples of seams + μ Σ ‖gᵢ − gⱼ‖² over edges within charts
/// ```
///
/// # Source
///
/// Waechter, Moehrle and Goesele, ECCV 2014, section 4.2; there at vertices, here along the edges;
/// there of colors, here of their logarithms, in which exposure and the fall of light to the corners
/// are the same for bright and for dark surfaces.
pub(super) fn level_seams(
    mesh: &TriangleMesh,
    fans: &Fans,
    charts: &[Chart],
    chart_of: &[Option<u32>],
    layout: &Layout,
    canvas: &mut Canvas,
) {
    let corrections = system(mesh, fans, charts, chart_of, layout, canvas).solve();
    let corrected: Vec<_> = charts
        .par_iter()
        .zip(&layout.places)
        .map(|(chart, &[x, y])| {
            let of_chart = &corrections[chart.first_vertex as usize..];
            let color = |texel: Texel| {
                let corners =
                    chart.triangles[texel.triangle as usize].map(|v| of_chart[v as usize]);
                let weighted = corners.into_iter().zip(texel.weights).map(|(c, w)| c * w);
                let gain = weighted.sum::<Color>().map(f64::exp);
                let index = canvas.index(x + texel.at[0], y + texel.at[1]);
                let color = Color::from(canvas.texture.pixels[index].map(f64::from));
                let color = color.add_scalar(DARK).component_mul(&gain).add_scalar(-DARK);
                (texel.at, color.map(|v| v.round().clamp(0.0, 255.0) as u8).into())
            };
            texels(chart, layout).into_iter().map(color).collect::<Vec<_>>()
        })
        .collect();
    for (place, patch) in layout.places.iter().zip(corrected) {
        canvas.put(*place, &patch);
    }
}

fn system(
    mesh: &TriangleMesh,
    fans: &Fans,
    charts: &[Chart],
    chart_of: &[Option<u32>],
    layout: &Layout,
    canvas: &Canvas,
) -> System {
    let len = charts.last().map_or(0, |c| c.first_vertex as usize + c.vertices.len());
    let mut system = System { rows: Vec::new(), len };
    let chart_at = |triangle: u32| chart_of[triangle as usize].map(|chart| chart as usize);
    for_each_edge(&mesh.triangles, fans, |edge, a, b| {
        let (Some(a), Some(b)) = (chart_at(a), b.and_then(chart_at)) else { return };
        let numbers = [a, b].map(|chart| edge.map(|v| charts[chart].number_of(v)));
        let [[Some(a0), Some(a1)], [Some(b0), Some(b1)]] = numbers else { return };
        if a == b {
            let weights = [1.0, -1.0, 0.0, 0.0].map(|w: f64| w * STIFFNESS.sqrt());
            system.rows.push(Row { vertices: [a0, a1, 0, 0], weights, value: Color::zeros() });
            return;
        }
        for sample in 0..NUM_SAMPLES {
            let t = (f64::from(sample) + 0.5) / f64::from(NUM_SAMPLES);
            let logarithm = |chart: usize, numbers: [u32; 2]| {
                let side = &charts[chart];
                let [p, q] =
                    numbers.map(|n| layout.in_chart(side, (n - side.first_vertex) as usize));
                let [x, y] = layout.places[chart].map(f64::from);
                let color = canvas.color_at(&(p + (q - p) * t + Vector2::new(x, y)));
                Color::from(color).map(|v| (v + DARK).ln())
            };
            let difference = logarithm(b, [b0, b1]) - logarithm(a, [a0, a1]);
            let doubt = 1.0 + (difference.norm() / PLAIN_DIFFERENCE).powi(2);
            let weight = (1.0 / (doubt * f64::from(NUM_SAMPLES))).sqrt();
            system.rows.push(Row {
                vertices: [a0, a1, b0, b1],
                weights: [1.0 - t, t, t - 1.0, -t].map(|w| w * weight),
                value: difference * weight,
            });
        }
    });
    system
}

/// `Σ weights g(vertices) = value`.
struct Row {
    vertices: [u32; 4],
    weights: [f64; 4],
    value: Color,
}

struct System {
    rows: Vec<Row>,
    len: usize,
}

impl System {
    /// Least squares by conjugate gradients on the normal equations, preconditioned by their
    /// diagonal; the three channels step together.
    fn solve(&self) -> Vec<Color> {
        let mut diagonal = vec![HOLD; self.len];
        let mut residual = vec![Color::zeros(); self.len];
        for row in &self.rows {
            for (&v, w) in row.vertices.iter().zip(row.weights) {
                diagonal[v as usize] += w * w;
                residual[v as usize] += row.value * w;
            }
        }
        let scaled = |residual: &[Color]| -> Vec<Color> {
            residual.iter().zip(&diagonal).map(|(r, d)| r / *d).collect()
        };
        let mut found = vec![Color::zeros(); self.len];
        let mut direction = scaled(&residual);
        let mut energy = dot(&residual, &direction);
        let enough = energy * (TOLERANCE * TOLERANCE);
        for _ in 0..MAX_STEPS {
            if energy.sum() <= enough.sum() {
                break;
            }
            let image = self.times(&direction);
            let step = ratio(energy, dot(&direction, &image));
            for i in 0..self.len {
                found[i] += direction[i].component_mul(&step);
                residual[i] -= image[i].component_mul(&step);
            }
            let next = scaled(&residual);
            let next_energy = dot(&residual, &next);
            let turn = ratio(next_energy, energy);
            for (d, n) in direction.iter_mut().zip(next) {
                *d = n + d.component_mul(&turn);
            }
            energy = next_energy;
        }
        found
    }

    /// `(AᵀA + HOLD) x`.
    fn times(&self, x: &[Color]) -> Vec<Color> {
        let mut result: Vec<Color> = x.iter().map(|x| x * HOLD).collect();
        for row in &self.rows {
            let mut value = Color::zeros();
            for (&v, w) in row.vertices.iter().zip(row.weights) {
                value += x[v as usize] * w;
            }
            for (&v, w) in row.vertices.iter().zip(row.weights) {
                result[v as usize] += value * w;
            }
        }
        result
    }
}

/// Per channel.
fn dot(a: &[Color], b: &[Color]) -> Color {
    a.iter().zip(b).map(|(a, b)| a.component_mul(b)).sum()
}

/// Per channel; a channel that is solved does not move.
fn ratio(a: Color, b: Color) -> Color {
    a.zip_map(&b, |a, b| if b > 0.0 { a / b } else { 0.0 })
}
