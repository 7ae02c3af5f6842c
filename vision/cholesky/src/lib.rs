//! Symmetric positive definite systems `A x = b`, by Cholesky's factorization `A = L Lᵀ`.
//!
//! Of A the lower triangle is read, by columns. One thread factors: blocked kernels that split over
//! threads may add in another order. The kernels are those of faer, compiled here once for all who
//! solve.

mod dense;
mod sparse;

pub use dense::{DenseCholesky, inverse};
pub use sparse::SparseCholesky;
