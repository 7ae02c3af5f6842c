//! Colors of vertices from the points.

use nalgebra::Point3;
use rayon::prelude::*;
use volery_geometry::KdTree;
use volery_scene::{PointCloud, TriangleMesh};

/// Points whose colors a vertex takes the mean of.
const NUM_NEIGHBORS: usize = 4;

/// Gives every vertex the mean color of the points nearest to it; none if there are no points.
pub fn color_vertices(mesh: &mut TriangleMesh, cloud: &PointCloud) {
    let points: Vec<Point3<f64>> = cloud.points.iter().map(|p| p.position.cast()).collect();
    if points.is_empty() {
        mesh.colors.clear();
        return;
    }
    let tree = KdTree::new(&points);
    let mean_color = |found: &mut Vec<_>, vertex: &Point3<f64>| {
        tree.nearest(vertex, NUM_NEIGHBORS, found);
        let mut sum = [0; 3];
        for neighbor in &*found {
            let color = cloud.points[neighbor.index as usize].color;
            sum.iter_mut().zip(color).for_each(|(sum, value)| *sum += usize::from(value));
        }
        sum.map(|sum| ((sum + found.len() / 2) / found.len()) as u8)
    };
    mesh.colors = mesh.vertices.par_iter().map_init(Vec::new, mean_color).collect();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_shapes::sphere;

    /// Colors that change linearly over space are found again where there are no points.
    #[test]
    fn colors_are_those_of_the_place() {
        let color_at = |x: f32| [(100.0 + 100.0 * x) as u8, 7, 255];
        let mut cloud = sphere(20_000, 1);
        cloud.points.iter_mut().for_each(|point| point.color = color_at(point.position.x));
        let vertices: Vec<Point3<f64>> =
            sphere(100, 2).points.iter().map(|point| point.position.cast()).collect();
        let mut mesh = TriangleMesh { vertices, ..TriangleMesh::default() };
        color_vertices(&mut mesh, &cloud);
        for (vertex, color) in mesh.vertices.iter().zip(&mesh.colors) {
            let truth = color_at(vertex.x as f32);
            assert!(color[0].abs_diff(truth[0]) <= 3, "{color:?} at {vertex}");
            assert_eq!(color[1..], truth[1..]);
        }
        color_vertices(&mut mesh, &PointCloud::default());
        assert!(mesh.colors.is_empty());
    }
}
