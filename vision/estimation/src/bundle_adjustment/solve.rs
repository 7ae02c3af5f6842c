//! Cholesky factorization of the reduced system, dense or sparse.
//!
//! One thread factors: blocked kernels that split over threads may add in another order.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::sparse::linalg::cholesky::{
    LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, MatRef, Par, Side};

use super::layout::Layout;
use super::schur::Pattern;

/// The reduced matrix with room for its factor.
pub(super) struct ReducedSystem {
    /// Start of each scalar column in `values`, and the end.
    pub(super) column_starts: Vec<usize>,
    /// Lower triangle by columns; destroyed by a dense factorization.
    pub(super) values: Vec<f64>,
    sparse: Option<SparseFactor>,
    memory: MemBuffer,
}

struct SparseFactor {
    rows: Vec<usize>,
    symbolic: SymbolicCholesky<usize>,
    factor: Vec<f64>,
}

impl ReducedSystem {
    /// `None` if the memory for it is not to be had.
    pub(super) fn new(layout: &Layout, pattern: &Pattern) -> Option<Self> {
        let n = layout.num_unknowns();
        if pattern.is_dense {
            let request =
                llt::factor::cholesky_in_place_scratch::<f64>(n, Par::Seq, Default::default());
            return Some(Self {
                column_starts: (0..=n).map(|column| column * n).collect(),
                values: vec![0.0; n * n],
                sparse: None,
                memory: MemBuffer::try_new(request).ok()?,
            });
        }
        let (column_starts, rows) = scalar_pattern(layout, pattern);
        let symbolic = factorize_symbolic_cholesky(
            SymbolicSparseColMatRef::new_checked(n, n, &column_starts, None, &rows),
            Side::Lower,
            SymmetricOrdering::Amd,
            Default::default(),
        )
        .ok()?;
        let request = symbolic
            .factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default())
            .or(symbolic.solve_in_place_scratch::<f64>(1, Par::Seq));
        Some(Self {
            values: vec![0.0; rows.len()],
            column_starts,
            memory: MemBuffer::try_new(request).ok()?,
            sparse: Some(SparseFactor { rows, factor: vec![0.0; symbolic.len_val()], symbolic }),
        })
    }

    /// Solves `S x = rhs` in place; `false` if S is not positive definite.
    pub(super) fn solve_in_place(&mut self, rhs: &mut [f64]) -> bool {
        let n = rhs.len();
        let stack = MemStack::new(&mut self.memory);
        let rhs = MatMut::from_column_major_slice_mut(rhs, n, 1);
        match &mut self.sparse {
            None => {
                let mut s = MatMut::from_column_major_slice_mut(&mut self.values, n, n);
                let factored = llt::factor::cholesky_in_place(
                    s.as_mut(),
                    Default::default(),
                    Par::Seq,
                    stack,
                    Default::default(),
                );
                if factored.is_err() {
                    return false;
                }
                let l: MatRef<'_, f64> = s.as_ref();
                llt::solve::solve_in_place_with_conj(l, Conj::No, rhs, Par::Seq, stack);
            }
            Some(sparse) => {
                let pattern = SymbolicSparseColMatRef::new_checked(
                    n,
                    n,
                    &self.column_starts,
                    None,
                    &sparse.rows,
                );
                let factored = sparse.symbolic.factorize_numeric_llt(
                    &mut sparse.factor,
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
                LltRef::new(&sparse.symbolic, &sparse.factor).solve_in_place_with_conj(
                    Conj::No,
                    rhs,
                    Par::Seq,
                    stack,
                );
            }
        }
        true
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
