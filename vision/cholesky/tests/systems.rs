//! Solutions by their residuals.

use volery_cholesky::{DenseCholesky, SparseCholesky, inverse};

/// Larger than the blocks of a dense factorization.
const N: usize = 150;

/// Values in [-1, 1), the same ones each time.
fn noise() -> impl FnMut() -> f64 {
    let mut state = 1u64;
    move || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// A symmetric matrix by columns, of a band and of a last row that ties all; its diagonal dominates.
fn arrow() -> Vec<f64> {
    let mut noise = noise();
    let mut a = vec![0.0; N * N];
    for column in 0..N {
        for row in column..N {
            let is_stored = row - column < 4 || row == N - 1;
            let value = if row == column { 2.0 * N as f64 } else { noise() };
            if is_stored {
                (a[column * N + row], a[row * N + column]) = (value, value);
            }
        }
    }
    a
}

fn product(a: &[f64], x: &[f64]) -> Vec<f64> {
    (0..N).map(|row| (0..N).map(|column| a[column * N + row] * x[column]).sum()).collect()
}

/// What is stored of the lower triangle: column starts, rows, values.
fn lower(a: &[f64]) -> (Vec<usize>, Vec<usize>, Vec<f64>) {
    let (mut starts, mut rows, mut values) = (vec![0], Vec::new(), Vec::new());
    for column in 0..N {
        for row in (column..N).filter(|row| a[column * N + row] != 0.0) {
            rows.push(row);
            values.push(a[column * N + row]);
        }
        starts.push(rows.len());
    }
    (starts, rows, values)
}

fn assert_near(one: &[f64], other: &[f64]) {
    assert_eq!(one.len(), other.len());
    for (x, y) in one.iter().zip(other) {
        assert!((x - y).abs() < 1e-12, "{x} and {y}");
    }
}

#[test]
fn dense_systems_are_solved() {
    let a = arrow();
    let mut noise = noise();
    let x: Vec<f64> = (0..N).map(|_| noise()).collect();
    let mut right = product(&a, &x);
    assert!(DenseCholesky::new(N).unwrap().solve_in_place(&mut a.clone(), &mut right));
    assert_near(&right, &x);
}

#[test]
fn sparse_systems_are_solved_for_all_right_hand_sides() {
    let a = arrow();
    let (starts, rows, values) = lower(&a);
    assert!(rows.len() < 6 * N);
    let mut noise = noise();
    let x: Vec<f64> = (0..3 * N).map(|_| noise()).collect();
    let mut cholesky = SparseCholesky::new(starts, rows, 3).unwrap();
    for scale in [1.0, 2.0] {
        let scaled: Vec<f64> = values.iter().map(|value| scale * value).collect();
        let mut right: Vec<f64> = x.chunks(N).flat_map(|x| product(&a, x)).collect();
        assert!(cholesky.solve_in_place(&scaled, &mut right));
        assert_near(&right.iter().map(|value| scale * value).collect::<Vec<_>>(), &x);
    }
}

#[test]
fn an_inverse_has_both_triangles() {
    let a = arrow();
    let inverse = inverse(N, a.clone()).unwrap();
    for (k, column) in inverse.chunks(N).enumerate() {
        let unit: Vec<f64> = (0..N).map(|row| f64::from(u8::from(row == k))).collect();
        assert_near(&product(&a, column), &unit);
    }
}

#[test]
fn an_indefinite_matrix_has_no_solution() {
    let mut a = arrow();
    a[70 * N + 70] = -1.0;
    let mut right = vec![1.0; N];
    let (starts, rows, values) = lower(&a);
    assert!(!SparseCholesky::new(starts, rows, 1).unwrap().solve_in_place(&values, &mut right));
    assert!(!DenseCholesky::new(N).unwrap().solve_in_place(&mut a.clone(), &mut right));
    assert!(inverse(N, a).is_none());
}
