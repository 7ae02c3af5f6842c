//! Matrices of which every value is stored, column after column.

use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt;
use faer::{Conj, MatMut, Par};

/// Room to solve systems of one size.
pub struct DenseCholesky {
    n: usize,
    memory: MemBuffer,
}

impl DenseCholesky {
    /// For matrices of n x n; `None` if there is no memory.
    pub fn new(n: usize) -> Option<Self> {
        let request =
            llt::factor::cholesky_in_place_scratch::<f64>(n, Par::Seq, Default::default());
        Some(Self { n, memory: MemBuffer::try_new(request).ok()? })
    }

    /// Solves `A x = right` in place and leaves the factor in `a`; `false` if A is not positive
    /// definite.
    #[must_use]
    pub fn solve_in_place(&mut self, a: &mut [f64], right: &mut [f64]) -> bool {
        let stack = MemStack::new(&mut self.memory);
        let mut a = MatMut::from_column_major_slice_mut(a, self.n, self.n);
        if !factor_in_place(a.as_mut(), stack) {
            return false;
        }
        let right = MatMut::from_column_major_slice_mut(right, self.n, 1);
        llt::solve::solve_in_place_with_conj(a.as_ref(), Conj::No, right, Par::Seq, stack);
        true
    }
}

/// The inverse of a matrix of n x n, both triangles; `None` if it is not positive definite, or if
/// there is no memory.
pub fn inverse(n: usize, mut a: Vec<f64>) -> Option<Vec<f64>> {
    let request = llt::factor::cholesky_in_place_scratch::<f64>(n, Par::Seq, Default::default())
        .or(llt::inverse::inverse_scratch::<f64>(n, Par::Seq));
    let mut memory = MemBuffer::try_new(request).ok()?;
    let stack = MemStack::new(&mut memory);
    let mut factor = MatMut::from_column_major_slice_mut(&mut a, n, n);
    if !factor_in_place(factor.as_mut(), stack) {
        return None;
    }
    let mut result = vec![0.0; n * n];
    let out = MatMut::from_column_major_slice_mut(&mut result, n, n);
    llt::inverse::inverse(out, factor.as_ref(), Par::Seq, stack);
    for column in 0..n {
        for row in column + 1..n {
            result[row * n + column] = result[column * n + row];
        }
    }
    Some(result)
}

fn factor_in_place(a: MatMut<'_, f64>, stack: &mut MemStack) -> bool {
    llt::factor::cholesky_in_place(a, Default::default(), Par::Seq, stack, Default::default())
        .is_ok()
}
