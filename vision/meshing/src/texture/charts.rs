//! Triangles that hang together and are painted from one view.

use nalgebra::Point2;
use volery_scene::TriangleMesh;

use super::view::View;
use crate::disjoint_sets::DisjointSets;
use crate::fans::{Fans, for_each_edge};

/// A part of the surface as one image shows it.
#[derive(Debug, Clone)]
pub(super) struct Chart {
    pub(super) view: u32,
    /// Vertices of the mesh, sorted.
    pub(super) vertices: Vec<u32>,
    /// Where the image shows them, pixels.
    pub(super) pixels: Vec<Point2<f64>>,
    /// Upper left and lower right of `pixels`.
    pub(super) bounds: [Point2<f64>; 2],
    /// Indices into `vertices`.
    pub(super) triangles: Vec<[u32; 3]>,
    /// How many vertices the charts before it have: all charts' vertices are numbered through.
    pub(super) first_vertex: u32,
}

impl Chart {
    /// Number of a vertex of the mesh among those of all charts.
    pub(super) fn number_of(&self, vertex: u32) -> Option<u32> {
        Some(self.first_vertex + self.vertices.binary_search(&vertex).ok()? as u32)
    }
}

/// The charts of labeled triangles, and the chart of every triangle.
pub(super) fn charts(
    mesh: &TriangleMesh,
    fans: &Fans,
    views: &[View],
    labels: &[Option<u32>],
) -> (Vec<Chart>, Vec<Option<u32>>) {
    let mut sets = DisjointSets::new(labels.len());
    for_each_edge(&mesh.triangles, fans, |_, a, b| {
        if let Some(b) = b
            && labels[a as usize] == labels[b as usize]
        {
            sets.join(a as usize, b as usize);
        }
    });
    let mut members: Vec<(u32, Vec<usize>)> = Vec::new();
    let mut chart_of = vec![None; labels.len()];
    for (triangle, label) in labels.iter().enumerate() {
        let Some(view) = *label else { continue };
        // The root is the least of its set and came before.
        let root = sets.root(triangle);
        let chart = chart_of[root].unwrap_or(members.len() as u32);
        if chart as usize == members.len() {
            members.push((view, Vec::new()));
        }
        members[chart as usize].1.push(triangle);
        chart_of[triangle] = Some(chart);
    }
    let mut first_vertex = 0;
    let charts = members.into_iter().map(|(view, triangles)| {
        let chart = chart(mesh, &views[view as usize], view, &triangles, first_vertex);
        first_vertex += chart.vertices.len() as u32;
        chart
    });
    (charts.collect(), chart_of)
}

fn chart(
    mesh: &TriangleMesh,
    view: &View,
    number: u32,
    triangles: &[usize],
    first_vertex: u32,
) -> Chart {
    let corners = || triangles.iter().map(|&t| mesh.triangles[t]);
    let mut vertices: Vec<u32> = corners().flatten().collect();
    vertices.sort_unstable();
    vertices.dedup();
    let pixel = |&v: &u32| view.project(&mesh.vertices[v as usize]).map(|(pixel, _)| pixel);
    let pixels: Vec<_> = vertices.iter().map(|v| pixel(v).unwrap_or_else(Point2::origin)).collect();
    let bounds = pixels.iter().fold([pixels[0]; 2], |[low, high], p| [low.inf(p), high.sup(p)]);
    let local = |v: u32| vertices.partition_point(|&other| other < v) as u32;
    let triangles = corners().map(|t| t.map(local)).collect();
    Chart { view: number, vertices, pixels, bounds, triangles, first_vertex }
}
