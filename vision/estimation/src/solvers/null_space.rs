//! Null space of a few rows.

/// Orthonormal vectors orthogonal to the `M` rows, by Householder reflections; `D = 9 − M`.
///
/// Rows that depend on each other leave a larger null space, of which `D` vectors are returned.
pub(super) fn null_space<const M: usize, const D: usize>(mut rows: [[f64; 9]; M]) -> [[f64; 9]; D] {
    const { assert!(M + D == 9) };
    // Each row is reflected onto the axes 0..=k; the reflections' product maps axes M.. to the
    // null space.
    let mut reflectors = [[0.0; 9]; M];
    for k in 0..M {
        let norm = rows[k][k..].iter().map(|v| v * v).sum::<f64>().sqrt();
        let mut v = rows[k];
        v[..k].fill(0.0);
        v[k] += norm.copysign(v[k]);
        let squared = v[k..].iter().map(|x| x * x).sum::<f64>();
        if squared > 0.0 {
            let scale = (2.0 / squared).sqrt();
            v[k..].iter_mut().for_each(|x| *x *= scale);
        }
        for row in &mut rows[k + 1..] {
            reflect(row, &v, k);
        }
        reflectors[k] = v;
    }
    let mut basis = [[0.0; 9]; D];
    for (d, vector) in basis.iter_mut().enumerate() {
        vector[M + d] = 1.0;
        for k in (0..M).rev() {
            reflect(vector, &reflectors[k], k);
        }
    }
    basis
}

/// `x − v vᵀ x`, `v` zero before `from` and of squared length 2.
#[inline]
fn reflect(x: &mut [f64; 9], v: &[f64; 9], from: usize) {
    let mut dot = 0.0;
    for i in from..9 {
        dot += v[i] * x[i];
    }
    for i in from..9 {
        x[i] -= dot * v[i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orthonormal_and_orthogonal_to_the_rows() {
        let rows: [[f64; 9]; 5] =
            std::array::from_fn(|i| std::array::from_fn(|j| ((3 * i + 7 * j * j) as f64).sin()));
        let basis: [[f64; 9]; 4] = null_space(rows);
        let dot = |a: &[f64; 9], b: &[f64; 9]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        for (i, b) in basis.iter().enumerate() {
            assert!(rows.iter().all(|r| dot(r, b).abs() < 1e-13));
            for (j, c) in basis.iter().enumerate() {
                assert!((dot(b, c) - f64::from(u8::from(i == j))).abs() < 1e-13);
            }
        }
    }
}
