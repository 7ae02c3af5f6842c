use approx::assert_relative_eq;

use super::*;

#[test]
fn strength_and_range_are_inverse() {
    let model = PathLoss::default();
    for distance in [0.2, 1.0, 3.7, 25.0] {
        let range = model.range(Point3::origin(), model.strength(distance));
        assert_relative_eq!(range.distance, distance, max_relative = 1e-12);
    }
    assert_relative_eq!(model.strength(1.0), -59.0);
    assert_relative_eq!(model.strength(10.0), -81.0);
}

/// The deviation of a range is what one of the strength does to it.
#[test]
fn the_deviation_is_the_derivative() {
    let model = PathLoss::default();
    let strength = model.strength(6.0);
    let (near, far) = (
        model.range(Point3::origin(), strength + 1e-4 * model.sigma_db),
        model.range(Point3::origin(), strength - 1e-4 * model.sigma_db),
    );
    let slope = (far.distance - near.distance) / 2e-4;
    assert_relative_eq!(model.range(Point3::origin(), strength).sigma, slope, max_relative = 1e-6);
}
