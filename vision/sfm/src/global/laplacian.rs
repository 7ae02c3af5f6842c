//! Sparse symmetric positive definite systems over a graph of images.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::cholesky::{
    LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};
use nalgebra::Vector3;

/// A matrix `Σ w (eⱼ − eᵢ)(eⱼ − eᵢ)ᵀ + diagonal` whose weights change and whose edges do not.
pub(crate) struct GraphLaplacian {
    num_nodes: usize,
    starts: Vec<usize>,
    rows: Vec<usize>,
    values: Vec<f64>,
    /// Value of each edge below the diagonal.
    edge_slots: Vec<usize>,
    symbolic: SymbolicCholesky<usize>,
    factor: Vec<f64>,
    memory: MemBuffer,
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
        let symbolic = factorize_symbolic_cholesky(
            SymbolicSparseColMatRef::new_checked(num_nodes, num_nodes, &starts, None, &rows),
            Side::Lower,
            SymmetricOrdering::Amd,
            Default::default(),
        )
        .ok()?;
        let request = symbolic
            .factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default())
            .or(symbolic.solve_in_place_scratch::<f64>(3, Par::Seq));
        Some(Self {
            num_nodes,
            values: vec![0.0; rows.len()],
            factor: vec![0.0; symbolic.len_val()],
            memory: MemBuffer::try_new(request).ok()?,
            starts,
            rows,
            edge_slots,
            symbolic,
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
        let stack = MemStack::new(&mut self.memory);
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &self.starts, None, &self.rows);
        let factored = self.symbolic.factorize_numeric_llt(
            &mut self.factor,
            SparseColMatRef::new(pattern, &self.values),
            Side::Lower,
            Default::default(),
            Par::Seq,
            stack,
            Default::default(),
        );
        if factored.is_err() {
            return false;
        }
        let mut columns: Vec<f64> =
            (0..3).flat_map(|axis| right.iter().map(move |v| v[axis])).collect();
        LltRef::new(&self.symbolic, &self.factor).solve_in_place_with_conj(
            Conj::No,
            MatMut::from_column_major_slice_mut(&mut columns, n, 3),
            Par::Seq,
            stack,
        );
        for (node, v) in right.iter_mut().enumerate() {
            *v = Vector3::new(columns[node], columns[n + node], columns[2 * n + node]);
        }
        right.iter().all(|v| v.iter().all(|x| x.is_finite()))
    }
}
