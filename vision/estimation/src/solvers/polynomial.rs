//! Real roots of polynomials.

use arrayvec::ArrayVec;

/// Largest degree of [`real_roots`].
pub const MAX_DEGREE: usize = 10;

/// Real roots of `a x² + b x + c`; of the linear rest if `a` vanishes. A double root is listed
/// twice.
pub fn quadratic_roots(a: f64, b: f64, c: f64) -> ArrayVec<f64, 2> {
    let mut roots = ArrayVec::new();
    if a == 0.0 {
        if b != 0.0 {
            roots.push(-c / b);
        }
        return roots;
    }
    let discriminant = b * b - 4.0 * a * c;
    // Rounding may push a double root just below zero.
    let slack = 1e-14 * (b * b + (4.0 * a * c).abs());
    if discriminant < -slack {
        return roots;
    }
    let q = -0.5 * (b + discriminant.max(0.0).sqrt().copysign(b));
    roots.push(q / a);
    if q != 0.0 {
        roots.push(c / q);
    } else {
        roots.push(0.0);
    }
    roots
}

/// Real roots of `a x³ + b x² + c x + d`, ascending degree of the rest if `a` vanishes.
pub fn cubic_roots(a: f64, b: f64, c: f64, d: f64) -> ArrayVec<f64, 3> {
    let mut roots = ArrayVec::new();
    let size = b.abs().max(c.abs()).max(d.abs());
    if a.abs() <= 1e-14 * size {
        roots.extend(quadratic_roots(b, c, d));
        return roots;
    }
    let (b, c, d) = (b / a, c / a, d / a);
    // x = y − b/3:  y³ + p y + q = 0
    let shift = b / 3.0;
    let p = c - b * shift;
    let q = d + shift * (2.0 * shift * shift - c);
    let (half_q, third_p) = (0.5 * q, p / 3.0);
    let discriminant = half_q * half_q + third_p * third_p * third_p;
    if discriminant >= 0.0 {
        let u = -(half_q.abs() + discriminant.sqrt()).cbrt().copysign(half_q);
        let v = if u != 0.0 { -third_p / u } else { 0.0 };
        roots.push(u + v - shift);
    } else {
        let m = 2.0 * (-third_p).sqrt();
        let angle = (-half_q / (-third_p * (-third_p).sqrt())).clamp(-1.0, 1.0).acos() / 3.0;
        for k in 0..3 {
            let turn = 2.0 * std::f64::consts::PI * f64::from(k) / 3.0;
            roots.push(m * (angle - turn).cos() - shift);
        }
    }
    for x in &mut roots {
        for _ in 0..2 {
            let value = ((*x + b) * *x + c) * *x + d;
            let slope = (3.0 * *x + 2.0 * b) * *x + c;
            let step = value / slope;
            if step.is_finite() && step.abs() < 0.1 * (1.0 + x.abs()) {
                *x -= step;
            }
        }
    }
    roots
}

/// Real roots of `Σ coefficients[i] xⁱ`, ascending, by Sturm's chain, bisection and Newton steps.
///
/// * `coefficients`: at most [`MAX_DEGREE`] + 1; anything else, or a value that is not finite,
///   gives no roots. Multiple roots are listed once.
pub fn real_roots(coefficients: &[f64]) -> ArrayVec<f64, MAX_DEGREE> {
    let mut roots = ArrayVec::new();
    if coefficients.len() > MAX_DEGREE + 1 || coefficients.iter().any(|c| !c.is_finite()) {
        return roots;
    }
    let largest = coefficients.iter().fold(0.0f64, |m, c| m.max(c.abs()));
    let mut degree = coefficients.len().saturating_sub(1);
    while degree > 0 && coefficients[degree].abs() <= 1e-16 * largest {
        degree -= 1;
    }
    if degree == 0 {
        return roots;
    }
    let lead = coefficients[degree];
    let mut chain =
        Chain { polynomials: [[0.0; MAX_DEGREE + 1]; MAX_DEGREE + 1], degrees: ArrayVec::new() };
    for (term, c) in chain.polynomials[0].iter_mut().zip(&coefficients[..=degree]) {
        *term = c / lead;
    }
    for i in 1..=degree {
        chain.polynomials[1][i - 1] = chain.polynomials[0][i] * i as f64;
    }
    chain.degrees.push(degree);
    chain.degrees.push(degree - 1);
    chain.complete();

    // Fujiwara's bound on the roots of a monic polynomial.
    let p = chain.polynomials[0];
    let bound =
        (1..=degree).map(|i| p[degree - i].abs().powf(1.0 / i as f64)).fold(0.0f64, f64::max) * 2.0
            + 1e-9;
    let mut stack = ArrayVec::<(f64, f64, usize, usize), 64>::new();
    stack.push((-bound, bound, chain.sign_changes(-bound), chain.sign_changes(bound)));
    while let Some((low, high, changes_low, changes_high)) = stack.pop() {
        let count = changes_low.saturating_sub(changes_high);
        if count == 0 {
            continue;
        }
        let middle = 0.5 * (low + high);
        let narrow = high - low <= 1e-11 * (1.0 + middle.abs());
        if count == 1 || narrow || stack.len() + 2 > stack.capacity() {
            let root = refine_root(&p[..=degree], low, high);
            if !roots.is_full() {
                roots.push(root);
            }
            continue;
        }
        let changes_middle = chain.sign_changes(middle);
        stack.push((middle, high, changes_middle, changes_high));
        stack.push((low, middle, changes_low, changes_middle));
    }
    roots
}

/// Sturm's chain: p, p′, and negated remainders, each scaled to unit size.
struct Chain {
    polynomials: [[f64; MAX_DEGREE + 1]; MAX_DEGREE + 1],
    degrees: ArrayVec<usize, { MAX_DEGREE + 1 }>,
}

impl Chain {
    fn complete(&mut self) {
        while self.degrees[self.degrees.len() - 1] > 0 && !self.degrees.is_full() {
            let k = self.degrees.len();
            let (n, m) = (self.degrees[k - 2], self.degrees[k - 1]);
            let mut rest = self.polynomials[k - 2];
            let divisor = self.polynomials[k - 1];
            for shift in (0..=n - m).rev() {
                let factor = rest[m + shift] / divisor[m];
                for i in 0..=m {
                    rest[i + shift] -= factor * divisor[i];
                }
            }
            let size = rest[..m].iter().fold(0.0f64, |s, c| s.max(c.abs()));
            if size <= 1e-300 {
                break;
            }
            let mut degree = m - 1;
            while degree > 0 && rest[degree].abs() <= 1e-15 * size {
                degree -= 1;
            }
            for (term, r) in self.polynomials[k].iter_mut().zip(&rest[..=degree]) {
                *term = -r / size;
            }
            self.degrees.push(degree);
        }
    }

    fn sign_changes(&self, x: f64) -> usize {
        let mut changes = 0;
        let mut previous = 0.0;
        for (polynomial, &degree) in self.polynomials.iter().zip(&self.degrees) {
            let value = horner(&polynomial[..=degree], x);
            if value != 0.0 {
                changes += usize::from(value * previous.signum_or_zero() < 0.0);
                previous = value;
            }
        }
        changes
    }
}

trait SignumOrZero {
    fn signum_or_zero(self) -> f64;
}

impl SignumOrZero for f64 {
    fn signum_or_zero(self) -> f64 {
        if self == 0.0 { 0.0 } else { self.signum() }
    }
}

fn horner(p: &[f64], x: f64) -> f64 {
    p.iter().rev().fold(0.0, |value, c| value * x + c)
}

/// Newton steps held inside the bracket by bisection.
fn refine_root(p: &[f64], mut low: f64, mut high: f64) -> f64 {
    // The bracket is open at `low`, which may be the root before this one.
    let at_high = horner(p, high);
    if at_high == 0.0 {
        return high;
    }
    let falling = at_high < 0.0;
    let mut x = 0.5 * (low + high);
    for _ in 0..80 {
        let (mut value, mut slope) = (0.0, 0.0);
        for c in p.iter().rev() {
            slope = slope * x + value;
            value = value * x + c;
        }
        if value == 0.0 {
            return x;
        }
        if (value > 0.0) == falling {
            low = x
        } else {
            high = x
        }
        let newton = x - value / slope;
        let next = if newton > low && newton < high { newton } else { 0.5 * (low + high) };
        if (next - x).abs() <= 1e-14 * (1.0 + x.abs()) {
            return next;
        }
        x = next;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    fn expand(roots: &[f64]) -> Vec<f64> {
        let mut p = vec![1.0];
        for r in roots {
            let mut q = vec![0.0; p.len() + 1];
            for (i, c) in p.iter().enumerate() {
                q[i + 1] += c;
                q[i] -= c * r;
            }
            p = q;
        }
        p
    }

    #[test]
    fn known_roots_come_back() {
        let truth = [-3.5, -1.0, -0.25, 0.0, 0.1, 0.7, 1.3, 2.0, 5.0, 9.0];
        for n in 1..=truth.len() {
            let found = real_roots(&expand(&truth[..n]));
            assert_eq!(found.len(), n);
            for (a, b) in found.iter().zip(&truth) {
                assert!((a - b).abs() < 1e-7, "{found:?}");
            }
        }
    }

    #[test]
    fn complex_pairs_are_left_out() {
        // (x² + 1)(x² + x + 3)(x − 2)
        let p = [-6.0, 1.0, -7.0, 2.0, -1.0, 1.0];
        let found = real_roots(&p);
        assert_eq!(found.len(), 1);
        assert!((found[0] - 2.0).abs() < 1e-12);
        assert!(quadratic_roots(1.0, 0.0, 1.0).is_empty());
    }

    #[test]
    fn cubics_by_formula() {
        for truth in [[-2.0, 0.5, 3.0], [1.0, 1.0001, 4.0], [-1e3, 1e-3, 1.0]] {
            let p = expand(&truth);
            let mut found = cubic_roots(2.0, 2.0 * p[2], 2.0 * p[1], 2.0 * p[0]);
            found.sort_by(f64::total_cmp);
            assert_eq!(found.len(), 3);
            for (a, b) in found.iter().zip(&truth) {
                assert!((a - b).abs() < 1e-6 * (1.0 + b.abs()), "{found:?}");
            }
        }
        assert_eq!(cubic_roots(0.0, 0.0, 2.0, -4.0).as_slice(), [2.0]);
        assert_eq!(cubic_roots(1.0, 0.0, 0.0, -8.0).as_slice(), [2.0]);
    }

    #[test]
    fn nothing_comes_of_nothing() {
        assert!(real_roots(&[]).is_empty());
        assert!(real_roots(&[1.0]).is_empty());
        assert!(real_roots(&[0.0, 0.0]).is_empty());
        assert!(real_roots(&[f64::NAN, 1.0]).is_empty());
        assert!(real_roots(&[1.0; 12]).is_empty());
    }
}
