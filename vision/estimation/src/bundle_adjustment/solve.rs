//! The reduced system and its solution, dense or sparse.

use volery_cholesky::{DenseCholesky, SparseCholesky};

use super::layout::Layout;
use super::schur::Pattern;

/// The reduced matrix with room for its factor.
pub(super) struct ReducedSystem {
    /// Start of each scalar column in `values`, and the end.
    pub(super) column_starts: Vec<usize>,
    /// Lower triangle by columns; destroyed by a dense factorization.
    pub(super) values: Vec<f64>,
    cholesky: Cholesky,
}

enum Cholesky {
    Dense(DenseCholesky),
    Sparse(Box<SparseCholesky>),
}

impl ReducedSystem {
    /// `None` if the memory for it is not to be had.
    pub(super) fn new(layout: &Layout, pattern: &Pattern) -> Option<Self> {
        if pattern.is_dense {
            let n = layout.num_unknowns();
            return Some(Self {
                column_starts: (0..=n).map(|column| column * n).collect(),
                values: vec![0.0; n * n],
                cholesky: Cholesky::Dense(DenseCholesky::new(n)?),
            });
        }
        let (column_starts, rows) = scalar_pattern(layout, pattern);
        let values = vec![0.0; rows.len()];
        let cholesky = SparseCholesky::new(column_starts.clone(), rows, 1)?;
        Some(Self { column_starts, values, cholesky: Cholesky::Sparse(Box::new(cholesky)) })
    }

    /// Solves `S x = rhs` in place; `false` if S is not positive definite.
    pub(super) fn solve_in_place(&mut self, rhs: &mut [f64]) -> bool {
        match &mut self.cholesky {
            Cholesky::Dense(cholesky) => cholesky.solve_in_place(&mut self.values, rhs),
            Cholesky::Sparse(cholesky) => cholesky.solve_in_place(&self.values, rhs),
        }
    }
}

/// Column starts and row indices of the lower triangle, scalar by scalar.
fn scalar_pattern(layout: &Layout, pattern: &Pattern) -> (Vec<usize>, Vec<usize>) {
    let mut starts = vec![0];
    let mut rows = Vec::new();
    for block in 0..layout.num_blocks() {
        for r in 0..layout.block_dims[block] {
            for &column in pattern.columns_of(block) {
                let column = column as usize;
                let skip = if column == block { r } else { 0 };
                let offset = layout.block_offsets[column];
                rows.extend(offset + skip..offset + layout.block_dims[column]);
            }
            starts.push(rows.len());
        }
    }
    (starts, rows)
}
