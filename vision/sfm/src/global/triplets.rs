//! Agreement of relative rotations around triangles of images.

use super::rotation_averaging::RotationEdge;

/// Turn left over around a triangle, radians, up to which its edges agree.
const MAX_LOOP_ERROR: f64 = 3.0 * std::f64::consts::PI / 180.0;
/// Part of its weight that an edge keeps which no triangle confirms but several deny.
const LEAST_TRUST: f64 = 0.01;

/// Lowers the weight of edges that most of their triangles deny: around images i, j, k the product
/// of the three rotations must be the identity. Edges without triangles keep their weight.
pub fn weigh_by_triplets(num_images: usize, edges: &mut [RotationEdge]) {
    let mut neighbors: Vec<Vec<(usize, usize)>> = vec![Vec::new(); num_images];
    for (index, edge) in edges.iter().enumerate() {
        if edge.i != edge.j && edge.i.max(edge.j) < num_images {
            neighbors[edge.i].push((edge.j, index));
            neighbors[edge.j].push((edge.i, index));
        }
    }
    for list in &mut neighbors {
        list.sort_unstable();
    }
    let trust: Vec<f64> = edges
        .iter()
        .map(|edge| {
            if edge.i == edge.j || edge.i.max(edge.j) >= num_images {
                return 1.0;
            }
            let (mut num_agreeing, mut num_triangles) = (0usize, 0usize);
            for (e_i, e_j) in common(&neighbors[edge.i], &neighbors[edge.j]) {
                let k = if edges[e_i].i == edge.i { edges[e_i].j } else { edges[e_i].i };
                let k_from_i = oriented(&edges[e_i], edge.i);
                let k_from_j = oriented(&edges[e_j], edge.j);
                debug_assert!(k != edge.i && k != edge.j);
                num_triangles += 1;
                let around = k_from_i.inverse() * k_from_j * edge.j_from_i;
                num_agreeing += usize::from(around.angle() <= MAX_LOOP_ERROR);
            }
            if num_triangles == 0 {
                return 1.0;
            }
            let agreement = num_agreeing as f64 / num_triangles as f64;
            (agreement * agreement).max(LEAST_TRUST)
        })
        .collect();
    for (edge, trust) in edges.iter_mut().zip(trust) {
        edge.weight *= trust;
    }
}

/// The edge's rotation from `from` to its other image.
fn oriented(edge: &RotationEdge, from: usize) -> nalgebra::UnitQuaternion<f64> {
    if edge.i == from { edge.j_from_i } else { edge.j_from_i.inverse() }
}

/// Edge pairs to the common neighbors of two sorted lists.
fn common<'a>(
    a: &'a [(usize, usize)],
    b: &'a [(usize, usize)],
) -> impl Iterator<Item = (usize, usize)> + 'a {
    a.iter().filter_map(move |&(node, edge_a)| {
        let at = b.partition_point(|&(other, _)| other < node);
        b.get(at).filter(|&&(other, _)| other == node).map(|&(_, edge_b)| (edge_a, edge_b))
    })
}
