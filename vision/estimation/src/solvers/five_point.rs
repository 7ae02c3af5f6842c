//! Essential matrix from five correspondences.

use arrayvec::ArrayVec;
use nalgebra::{Matrix3, Vector3};

use super::null_space::null_space;
use super::polynomial::real_roots;

/// Monomials of degree ≤ 1: x, y, z, 1.
type Linear = [f64; 4];
/// x², xy, xz, x, y², yz, y, z², z, 1.
type Quadratic = [f64; 10];
/// x³, y³, x²y, xy², x²z, x², y²z, y², xyz, xy, xz², xz, x, yz², yz, y, z³, z², z, 1.
type Cubic = [f64; 20];

/// Index of the product of two linear monomials.
const QUADRATIC: [[usize; 4]; 4] = [[0, 1, 2, 3], [1, 4, 5, 6], [2, 5, 7, 8], [3, 6, 8, 9]];
/// Index of the product of a quadratic and a linear monomial.
const CUBIC: [[usize; 4]; 10] = [
    [0, 2, 4, 5],
    [2, 3, 8, 9],
    [4, 8, 10, 11],
    [5, 9, 11, 12],
    [3, 1, 6, 7],
    [8, 6, 13, 14],
    [9, 7, 14, 15],
    [10, 13, 16, 17],
    [11, 14, 17, 18],
    [12, 15, 18, 19],
];

/// Essential matrices of five correspondences, up to ten, of unit Frobenius norm.
///
/// ```text
/// x₂ᵀ E x₁ = 0,   det E = 0,   E Eᵀ E − ½ tr(E Eᵀ) E = 0
/// ```
///
/// * `x1`, `x2`: rays in each camera's frame, any length.
///
/// Source: Nistér, "An Efficient Solution to the Five-Point Relative Pose Problem", PAMI 2004.
/// The unknowns x, y, z weigh a basis of the null space; z is a root of a polynomial of degree
/// ten.
pub fn relpose_5pt(x1: &[Vector3<f64>; 5], x2: &[Vector3<f64>; 5]) -> ArrayVec<Matrix3<f64>, 10> {
    let rows: [[f64; 9]; 5] = std::array::from_fn(|i| {
        let (p, q) = (&x1[i], &x2[i]);
        [
            q.x * p.x,
            q.x * p.y,
            q.x * p.z,
            q.y * p.x,
            q.y * p.y,
            q.y * p.z,
            q.z * p.x,
            q.z * p.y,
            q.z * p.z,
        ]
    });
    let basis: [[f64; 9]; 4] = null_space(rows);
    let mut solutions = ArrayVec::new();
    let Some(reduced) = reduce(constraints(&basis)) else { return solutions };

    // (11)–(13): rows in x, y, 1 whose entries are polynomials in z, ascending.
    let b: [([f64; 4], [f64; 4], [f64; 5]); 3] = std::array::from_fn(|i| {
        let (e, f) = (&reduced[2 * i], &reduced[2 * i + 1]);
        (
            [e[2], e[1] - f[2], e[0] - f[1], -f[0]],
            [e[5], e[4] - f[5], e[3] - f[4], -f[3]],
            [e[9], e[8] - f[9], e[7] - f[8], e[6] - f[7], -f[6]],
        )
    });
    let p1: [f64; 8] = difference(&b[0].1, &b[1].2, &b[0].2, &b[1].1);
    let p2: [f64; 8] = difference(&b[0].2, &b[1].0, &b[0].0, &b[1].2);
    let p3: [f64; 7] = difference(&b[0].0, &b[1].1, &b[0].1, &b[1].0);
    let mut determinant = [0.0; 11];
    accumulate(&mut determinant, &p1, &b[2].0, 1.0);
    accumulate(&mut determinant, &p2, &b[2].1, 1.0);
    accumulate(&mut determinant, &p3, &b[2].2, 1.0);

    let evaluate = |p: &[f64], z: f64| p.iter().rev().fold(0.0, |value, c| value * z + c);
    for z in real_roots(&determinant) {
        let w = evaluate(&p3, z);
        let (x, y) = (evaluate(&p1, z) / w, evaluate(&p2, z) / w);
        let e = Matrix3::from_row_iterator(
            (0..9).map(|i| x * basis[0][i] + y * basis[1][i] + z * basis[2][i] + basis[3][i]),
        );
        let norm = e.norm();
        if norm.is_finite() && norm > 0.0 {
            solutions.push(e / norm);
        }
    }
    solutions
}

/// The ten cubic constraints of E = x X + y Y + z Z + W.
fn constraints(basis: &[[f64; 9]; 4]) -> [Cubic; 10] {
    let e: [Linear; 9] = std::array::from_fn(|i| std::array::from_fn(|k| basis[k][i]));
    let mut equations = [[0.0; 20]; 10];

    // E Eᵀ − ½ tr(E Eᵀ) I
    let mut gram = [[[0.0; 10]; 3]; 3];
    for i in 0..3 {
        for j in i..3 {
            let mut sum = [0.0; 10];
            for k in 0..3 {
                add_product(&mut sum, &e[3 * i + k], &e[3 * j + k], 1.0);
            }
            gram[i][j] = sum;
            gram[j][i] = sum;
        }
    }
    let half_trace: Quadratic =
        std::array::from_fn(|m| 0.5 * (gram[0][0][m] + gram[1][1][m] + gram[2][2][m]));
    for (i, row) in gram.iter_mut().enumerate() {
        for (term, half) in row[i].iter_mut().zip(&half_trace) {
            *term -= half;
        }
    }
    for i in 0..3 {
        for j in 0..3 {
            for k in 0..3 {
                add_cubic(&mut equations[3 * i + j], &gram[i][k], &e[3 * k + j]);
            }
        }
    }
    // det E by the first row.
    for (column, (a, b)) in [(1, 2), (2, 0), (0, 1)].into_iter().enumerate() {
        let mut minor = [0.0; 10];
        add_product(&mut minor, &e[3 + a], &e[6 + b], 1.0);
        add_product(&mut minor, &e[3 + b], &e[6 + a], -1.0);
        add_cubic(&mut equations[9], &minor, &e[column]);
    }
    equations
}

#[inline]
fn add_product(sum: &mut Quadratic, a: &Linear, b: &Linear, sign: f64) {
    for i in 0..4 {
        for j in 0..4 {
            sum[QUADRATIC[i][j]] += sign * a[i] * b[j];
        }
    }
}

#[inline]
fn add_cubic(sum: &mut Cubic, a: &Quadratic, b: &Linear) {
    for i in 0..10 {
        for j in 0..4 {
            sum[CUBIC[i][j]] += a[i] * b[j];
        }
    }
}

/// Gauss–Jordan on the first ten monomials; the other ten coefficients of rows 4 to 9.
fn reduce(mut m: [Cubic; 10]) -> Option<[[f64; 10]; 6]> {
    for column in 0..10 {
        let pivot = (column..10)
            .max_by(|&i, &j| m[i][column].abs().total_cmp(&m[j][column].abs()))
            .unwrap_or(column);
        let size = m[pivot][column].abs();
        if size.is_nan() || size <= 1e-14 {
            return None;
        }
        m.swap(column, pivot);
        let inverse = 1.0 / m[column][column];
        let mut leader = m[column];
        for value in &mut leader[column..] {
            *value *= inverse;
        }
        m[column] = leader;
        // Rows above 4 are not needed once they are used.
        for (i, row) in m.iter_mut().enumerate() {
            if i != column && (i > column || i >= 4) {
                let factor = row[column];
                for k in column..20 {
                    row[k] -= factor * leader[k];
                }
            }
        }
    }
    Some(std::array::from_fn(|i| std::array::from_fn(|k| m[4 + i][10 + k])))
}

/// `a·b − c·d` of polynomials.
fn difference<const N: usize>(a: &[f64], b: &[f64], c: &[f64], d: &[f64]) -> [f64; N] {
    let mut result = [0.0; N];
    accumulate(&mut result, a, b, 1.0);
    accumulate(&mut result, c, d, -1.0);
    result
}

fn accumulate(result: &mut [f64], a: &[f64], b: &[f64], sign: f64) {
    for (i, x) in a.iter().enumerate() {
        for (j, y) in b.iter().enumerate() {
            result[i + j] += sign * x * y;
        }
    }
}
