//! Which view each triangle is painted from.

use rayon::prelude::*;
use volery_rendering::DrawableMesh;
use volery_scene::{Cancelled, Progress, Stage, TriangleMesh};

use super::view::View;
use crate::fans::{Fans, for_each_edge};

/// Views per triangle among which is chosen: the best.
const MAX_CANDIDATES: usize = 12;
/// Cost of a seam as long as a mean edge, in units of the cost of painting a mean triangle without
/// any resolution.
pub(super) const SEAM_COST: f32 = 0.5;
/// Forward and backward passes.
const NUM_PASSES: usize = 8;
/// Views that are judged at once.
const CHUNK: usize = 8;

/// A view that sees a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Candidate {
    pub(super) view: u32,
    /// Pixels, weighted by how frontal they are; later the cost.
    pub(super) quality: f32,
}

/// The best views of every triangle, sorted by view.
pub(super) fn candidates(
    mesh: &TriangleMesh,
    drawable: &DrawableMesh,
    views: &[View],
    progress: &dyn Progress,
) -> Result<Vec<Vec<Candidate>>, Cancelled> {
    let mut all: Vec<Vec<Candidate>> = vec![Vec::new(); mesh.triangles.len()];
    for (chunk, some) in views.chunks(CHUNK).enumerate() {
        progress.check()?;
        let seen: Vec<_> =
            some.par_iter().map(|view| view.seen_triangles(mesh, drawable)).collect();
        for (i, of_view) in seen.into_iter().enumerate() {
            let view = (chunk * CHUNK + i) as u32;
            for (triangle, quality) in of_view {
                insert(&mut all[triangle as usize], Candidate { view, quality });
            }
        }
        progress.report(Stage::Texturing, chunk * CHUNK + some.len(), 2 * views.len());
    }
    Ok(all)
}

/// Keeps the best; the last of equals goes.
fn insert(list: &mut Vec<Candidate>, candidate: Candidate) {
    if list.len() == MAX_CANDIDATES {
        let worst = (1..list.len())
            .fold(0, |worst, i| if list[i].quality <= list[worst].quality { i } else { worst });
        if list[worst].quality >= candidate.quality {
            return;
        }
        list.remove(worst);
    }
    list.push(candidate);
}

/// One view per triangle, `None` where no view sees it: sharp, and with few seams.
///
/// Minimizes, over a label per triangle,
///
/// ```text
/// Σ area (1 − quality / best quality) + λ Σ length of edges between unlike labels
/// ```
///
/// # Source
///
/// The energy: Waechter, Moehrle and Goesele, "Let There Be Color! Large-Scale Texturing of 3D
/// Reconstructions", ECCV 2014, eq. (1). The solver: Kolmogorov, "Convergent Tree-Reweighted
/// Message Passing for Energy Minimization", PAMI 2006, section 5 (TRW-S), with labels read off in
/// order.
pub(super) fn choose_views(
    mesh: &TriangleMesh,
    fans: &Fans,
    mut candidates: Vec<Vec<Candidate>>,
) -> Vec<Option<u32>> {
    let links = Links::new(mesh, fans, &candidates);
    let areas: Vec<f32> = mesh.triangles.iter().map(|&t| area(mesh, t) as f32).collect();
    let mean_area = areas.iter().sum::<f32>() / areas.len().max(1) as f32;
    for (list, area) in candidates.iter_mut().zip(&areas) {
        let best = list.iter().map(|c| c.quality).fold(0.0, f32::max);
        let weight = area / mean_area.max(f32::MIN_POSITIVE);
        list.iter_mut().for_each(|c| c.quality = weight * (1.0 - c.quality / best));
    }
    let mut messages = Messages::new(&links, &candidates);
    for _ in 0..NUM_PASSES {
        messages.pass(&links, &candidates, false);
        messages.pass(&links, &candidates, true);
    }
    messages.read_labels(&links, &candidates)
}

fn area(mesh: &TriangleMesh, triangle: [u32; 3]) -> f64 {
    let [a, b, c] = triangle.map(|v| mesh.vertices[v as usize]);
    0.5 * (b - a).cross(&(c - a)).norm()
}

/// Neighbors of the triangles that are seen, in both directions.
struct Links {
    /// Per triangle, its first link; one more at the end.
    starts: Vec<u32>,
    links: Vec<Link>,
}

#[derive(Clone, Copy)]
struct Link {
    to: u32,
    /// The same link seen from there.
    back: u32,
    weight: f32,
}

impl Links {
    fn new(mesh: &TriangleMesh, fans: &Fans, candidates: &[Vec<Candidate>]) -> Self {
        let mut edges: Vec<(u32, u32, f32)> = Vec::new();
        for_each_edge(&mesh.triangles, fans, |[a, b], t, other| {
            let seen = |t: u32| !candidates[t as usize].is_empty();
            if let Some(other) = other
                && t != other
                && seen(t)
                && seen(other)
            {
                let length =
                    nalgebra::distance(&mesh.vertices[a as usize], &mesh.vertices[b as usize]);
                edges.push((t, other, length as f32));
            }
        });
        let mean = edges.iter().map(|e| e.2).sum::<f32>() / edges.len().max(1) as f32;
        let mut starts = vec![0; mesh.triangles.len() + 1];
        edges.iter().for_each(|&(a, b, _)| [a, b].iter().for_each(|&t| starts[t as usize] += 1));
        let mut sum = 0;
        for start in &mut starts {
            sum += *start;
            *start = sum;
        }
        let mut links = vec![Link { to: 0, back: 0, weight: 0.0 }; 2 * edges.len()];
        for (a, b, length) in edges {
            let weight = SEAM_COST * length / mean.max(f32::MIN_POSITIVE);
            starts[a as usize] -= 1;
            starts[b as usize] -= 1;
            let (at_a, at_b) = (starts[a as usize], starts[b as usize]);
            links[at_a as usize] = Link { to: b, back: at_b, weight };
            links[at_b as usize] = Link { to: a, back: at_a, weight };
        }
        Self { starts, links }
    }

    fn of(&self, triangle: usize) -> std::ops::Range<usize> {
        self.starts[triangle] as usize..self.starts[triangle + 1] as usize
    }
}

/// What neighbors say of the labels of a triangle: per link, one number for each candidate of the
/// triangle from which the link starts.
struct Messages {
    starts: Vec<u32>,
    values: Vec<f32>,
    sums: Vec<f32>,
}

impl Messages {
    fn new(links: &Links, candidates: &[Vec<Candidate>]) -> Self {
        let mut starts = Vec::with_capacity(links.links.len());
        let mut len = 0;
        for (triangle, list) in candidates.iter().enumerate() {
            for _ in links.of(triangle) {
                starts.push(len as u32);
                len += list.len();
            }
        }
        Self { starts, values: vec![0.0; len], sums: Vec::new() }
    }

    fn of(&self, link: usize, len: usize) -> &[f32] {
        &self.values[self.starts[link] as usize..][..len]
    }

    /// Costs of a triangle with all that is said of them.
    fn sum(&mut self, links: &Links, triangle: usize, list: &[Candidate]) {
        let mut sums = std::mem::take(&mut self.sums);
        sums.clear();
        sums.extend(list.iter().map(|c| c.quality));
        for link in links.of(triangle) {
            sums.iter_mut().zip(self.of(link, list.len())).for_each(|(sum, said)| *sum += said);
        }
        self.sums = sums;
    }

    /// Every triangle in order tells those after it, or in reverse those before it.
    fn pass(&mut self, links: &Links, candidates: &[Vec<Candidate>], reverse: bool) {
        let n = candidates.len();
        for step in 0..n {
            let triangle = if reverse { n - 1 - step } else { step };
            let list = &candidates[triangle];
            let range = links.of(triangle);
            let later = range.clone().filter(|&l| (links.links[l].to as usize) > triangle).count();
            let gamma = 1.0 / later.max(range.len() - later).max(1) as f32;
            self.sum(links, triangle, list);
            for link in range {
                let Link { to, back, weight } = links.links[link];
                if ((to as usize) > triangle) != reverse {
                    self.tell(
                        link,
                        back as usize,
                        (list, &candidates[to as usize]),
                        (gamma, weight),
                    );
                }
            }
        }
    }

    /// `m(l) = min(h(l), min h + weight)`, `h = γ θ − m_back`, for the labels of the neighbor.
    fn tell(
        &mut self,
        link: usize,
        back: usize,
        (own, theirs): (&[Candidate], &[Candidate]),
        (gamma, weight): (f32, f32),
    ) {
        let (start, target) = (self.starts[link] as usize, self.starts[back] as usize);
        let Self { values, sums, .. } = self;
        let h = |values: &[f32], i: usize| gamma * sums[i] - values[start + i];
        let least = (0..own.len()).map(|i| h(values, i)).fold(f32::INFINITY, f32::min);
        let mut i = 0;
        for (j, label) in theirs.iter().enumerate() {
            while i < own.len() && own[i].view < label.view {
                i += 1;
            }
            let same = own.get(i).is_some_and(|c| c.view == label.view);
            let value = if same { (h(values, i) - least).min(weight) } else { weight };
            values[target + j] = value;
        }
    }

    /// The cheapest label of each triangle beside the labels of those before it.
    fn read_labels(mut self, links: &Links, candidates: &[Vec<Candidate>]) -> Vec<Option<u32>> {
        let mut labels: Vec<Option<u32>> = vec![None; candidates.len()];
        for (triangle, list) in candidates.iter().enumerate() {
            self.sums.clear();
            self.sums.extend(list.iter().map(|c| c.quality));
            for link in links.of(triangle) {
                let Link { to, weight, .. } = links.links[link];
                let said = &self.values[self.starts[link] as usize..][..list.len()];
                for (i, sum) in self.sums.iter_mut().enumerate() {
                    *sum += if to as usize > triangle {
                        said[i]
                    } else if labels[to as usize] == Some(list[i].view) {
                        0.0
                    } else {
                        weight
                    };
                }
            }
            let least = (0..list.len()).min_by(|&a, &b| self.sums[a].total_cmp(&self.sums[b]));
            labels[triangle] = least.map(|i| list[i].view);
        }
        labels
    }
}
