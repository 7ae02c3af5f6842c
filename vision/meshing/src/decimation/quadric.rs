//! How far a point is from a sheaf of planes.

use nalgebra::Vector3;

/// Weight, relative to the planes, that holds a point where it is.
const HOLD: f64 = 1e-4;

/// The sum of squared distances to weighted planes, `xᵀ A x + 2 bᵀ x + c`, about a local origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Quadric {
    /// xx, xy, xz, yy, yz, zz of the symmetric A.
    a: [f64; 6],
    b: Vector3<f64>,
    c: f64,
}

impl Quadric {
    pub(super) const ZERO: Self = Self { a: [0.0; 6], b: Vector3::new(0.0, 0.0, 0.0), c: 0.0 };

    /// Of the plane through `point` with a unit `normal`.
    pub(super) fn of_plane(point: Vector3<f64>, n: Vector3<f64>, weight: f64) -> Self {
        let offset = -n.dot(&point);
        let products = [n.x * n.x, n.x * n.y, n.x * n.z, n.y * n.y, n.y * n.z, n.z * n.z];
        Self {
            a: products.map(|v| v * weight),
            b: n * (offset * weight),
            c: offset * offset * weight,
        }
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.a.iter_mut().zip(other.a).for_each(|(own, other)| *own += other);
        self.b += other.b;
        self.c += other.c;
    }

    fn times(&self, x: Vector3<f64>) -> Vector3<f64> {
        let [xx, xy, xz, yy, yz, zz] = self.a;
        Vector3::new(
            xx * x.x + xy * x.y + xz * x.z,
            xy * x.x + yy * x.y + yz * x.z,
            xz * x.x + yz * x.y + zz * x.z,
        )
    }

    pub(super) fn at(&self, x: Vector3<f64>) -> f64 {
        (x.dot(&self.times(x)) + 2.0 * self.b.dot(&x) + self.c).max(0.0)
    }

    /// The point nearest to all planes that stays at `start` as far as they leave it free:
    /// `(A + ε I) (x − start) = −(A start + b)`.
    pub(super) fn minimum_near(&self, start: Vector3<f64>) -> Vector3<f64> {
        let [mut xx, xy, xz, mut yy, yz, mut zz] = self.a;
        let hold = HOLD * (xx + yy + zz);
        xx += hold;
        yy += hold;
        zz += hold;
        let down = self.times(start) + self.b;
        // Cofactors.
        let (c_xx, c_xy, c_xz) = (yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy);
        let (c_yy, c_yz, c_zz) = (xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy);
        let determinant = xx * c_xx + xy * c_xy + xz * c_xz;
        let step = Vector3::new(
            c_xx * down.x + c_xy * down.y + c_xz * down.z,
            c_xy * down.x + c_yy * down.y + c_yz * down.z,
            c_xz * down.x + c_yz * down.y + c_zz * down.z,
        ) / determinant;
        // Without any plane nothing pulls.
        if step.iter().all(|v| v.is_finite()) { start - step } else { start }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planes(normals: &[Vector3<f64>], through: Vector3<f64>) -> Quadric {
        let mut sum = Quadric::ZERO;
        for normal in normals {
            sum.add(&Quadric::of_plane(through, normal.normalize(), 2.0));
        }
        sum
    }

    #[test]
    fn a_corner_is_found() {
        let corner = Vector3::new(3.0, -1.0, 0.5);
        let normals = [Vector3::new(1.0, 0.2, 0.0), Vector3::new(0.0, 1.0, 0.3), Vector3::z()];
        let quadric = planes(&normals, corner);
        let start = corner + Vector3::new(0.1, 0.1, -0.1);
        let found = quadric.minimum_near(start);
        assert!((found - corner).norm() < 0.01 * (start - corner).norm(), "{found}");
        assert!(quadric.at(corner) < 1e-12 && quadric.at(start) > 1e-3);
    }

    #[test]
    fn along_a_plane_nothing_moves() {
        let quadric = planes(&[Vector3::z()], Vector3::zeros());
        let found = quadric.minimum_near(Vector3::new(5.0, 7.0, 1.0));
        assert!((found - Vector3::new(5.0, 7.0, 0.0)).norm() < 2e-3, "{found}");
        let still = Vector3::new(1.0, 2.0, 3.0);
        assert_eq!(Quadric::ZERO.minimum_near(still), still);
    }
}
