//! Sparse symmetric positive definite systems over a graph of images.

use nalgebra::Vector3;
use volery_cholesky::SparseCholesky;

/// A matrix `Σ w (eⱼ − eᵢ)(eⱼ − eᵢ)ᵀ + diagonal` whose weights change and whose edges do not.
pub(crate) struct GraphLaplacian {
    num_nodes: usize,
    starts: Vec<usize>,
    values: Vec<f64>,
    /// Value of each edge below the diagonal.
    edge_slots: Vec<usize>,
    cholesky: SparseCholesky,
}

impl GraphLaplacian {
    /// `edges`: pairs of different nodes. `None` if there is no memory.
    pub(crate) fn new(num_nodes: usize, edges: &[(usize, usize)]) -> Option<Self> {
        let mut columns: Vec<Vec<usize>> = (0..num_nodes).map(|node| vec![node]).collect();
        for &(i, j) in edges {
            columns[i.min(j)].push(i.max(j));
        }
        let mut starts = vec![0];
        let mut rows = Vec::new();
        for column in &mut columns {
            column.sort_unstable();
            column.dedup();
            rows.extend_from_slice(column);
            starts.push(rows.len());
        }
        let slot = |&(i, j): &(usize, usize)| {
            let column = starts[i.min(j)]..starts[i.min(j) + 1];
            column.start + rows[column].partition_point(|&row| row < i.max(j))
        };
        let edge_slots = edges.iter().map(slot).collect();
        Some(Self {
            num_nodes,
            values: vec![0.0; rows.len()],
            cholesky: SparseCholesky::new(starts.clone(), rows, 3)?,
            starts,
            edge_slots,
        })
    }

    /// Solves for three right-hand sides at once, in place; `false` if the matrix is not positive
    /// definite.
    pub(crate) fn solve(
        &mut self,
        edges: &[(usize, usize)],
        weights: &[f64],
        diagonal: &[f64],
        right: &mut [Vector3<f64>],
    ) -> bool {
        let n = self.num_nodes;
        self.values.fill(0.0);
        for (node, value) in diagonal.iter().enumerate() {
            self.values[self.starts[node]] += value;
        }
        for ((&(i, j), &weight), &slot) in edges.iter().zip(weights).zip(&self.edge_slots) {
            self.values[slot] -= weight;
            self.values[self.starts[i]] += weight;
            self.values[self.starts[j]] += weight;
        }
        let mut columns: Vec<f64> =
            (0..3).flat_map(|axis| right.iter().map(move |v| v[axis])).collect();
        if !self.cholesky.solve_in_place(&self.values, &mut columns) {
            return false;
        }
        for (node, v) in right.iter_mut().enumerate() {
            *v = Vector3::new(columns[node], columns[n + node], columns[2 * n + node]);
        }
        right.iter().all(|v| v.iter().all(|x| x.is_finite()))
    }
}
