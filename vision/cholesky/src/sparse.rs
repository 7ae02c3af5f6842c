//! Matrices of which most values are zero.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::cholesky::{
    LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};

/// Systems of one pattern, ordered once by approximate minimum degree.
pub struct SparseCholesky {
    /// Start of each column in the values, and the end.
    column_starts: Vec<usize>,
    rows: Vec<usize>,
    symbolic: SymbolicCholesky<usize>,
    factor: Vec<f64>,
    num_right: usize,
    memory: MemBuffer,
}

impl SparseCholesky {
    /// `column_starts`: start of each column in `rows`, and the end. `rows`: ascending in each column,
    /// none above the diagonal. `num_right`: right-hand sides that are solved for at once. `None` if
    /// there is no memory.
    pub fn new(column_starts: Vec<usize>, rows: Vec<usize>, num_right: usize) -> Option<Self> {
        let symbolic = factorize_symbolic_cholesky(
            pattern(&column_starts, &rows),
            Side::Lower,
            SymmetricOrdering::Amd,
            Default::default(),
        )
        .ok()?;
        let request = symbolic
            .factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default())
            .or(symbolic.solve_in_place_scratch::<f64>(num_right, Par::Seq));
        Some(Self {
            column_starts,
            rows,
            factor: vec![0.0; symbolic.len_val()],
            symbolic,
            num_right,
            memory: MemBuffer::try_new(request).ok()?,
        })
    }

    /// Solves `A x = right` in place. `values` of A as the rows lie; `right` one column after another.
    /// `false` if A is not positive definite.
    #[must_use]
    pub fn solve_in_place(&mut self, values: &[f64], right: &mut [f64]) -> bool {
        let n = self.column_starts.len() - 1;
        let stack = MemStack::new(&mut self.memory);
        let factored = self.symbolic.factorize_numeric_llt(
            &mut self.factor,
            SparseColMatRef::new(pattern(&self.column_starts, &self.rows), values),
            Side::Lower,
            Default::default(),
            Par::Seq,
            stack,
            Default::default(),
        );
        if factored.is_err() {
            return false;
        }
        let right = MatMut::from_column_major_slice_mut(right, n, self.num_right);
        let factor = LltRef::new(&self.symbolic, &self.factor);
        factor.solve_in_place_with_conj(Conj::No, right, Par::Seq, stack);
        true
    }
}

fn pattern<'a>(starts: &'a [usize], rows: &'a [usize]) -> SymbolicSparseColMatRef<'a, usize> {
    let n = starts.len() - 1;
    SymbolicSparseColMatRef::new_checked(n, n, starts, None, rows)
}
