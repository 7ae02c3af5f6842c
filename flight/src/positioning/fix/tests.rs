use approx::assert_relative_eq;
use nalgebra::Vector3;
use volery_geometry::Rng;

use super::*;
use crate::positioning::PathLoss;

/// Three emitters as in the paper's figure 17a, one more, and their heights.
fn beacons() -> Vec<Point3<f64>> {
    [(0.0, 0.0, 2.0), (8.0, 0.5, 2.2), (4.0, 7.0, 1.8), (8.0, 7.0, 2.0)]
        .map(|(x, y, z)| Point3::new(x, y, z))
        .to_vec()
}

fn exact(beacons: &[Point3<f64>], at: &Point3<f64>) -> Vec<Range> {
    let range =
        |&beacon: &Point3<f64>| Range { beacon, distance: (at - beacon).norm(), sigma: 0.1 };
    beacons.iter().map(range).collect()
}

/// P92: true ranges give the true place, with three emitters and with more.
#[test]
fn exact_ranges_give_the_place() {
    let mut rng = Rng::new(12);
    for _ in 0..300 {
        let at = Point3::new(rng.range(-1.0, 9.0), rng.range(-1.0, 8.0), rng.range(0.3, 2.5));
        for count in [3, 4] {
            let fix = trilaterate(&exact(&beacons()[..count], &at), at.z).unwrap();
            assert_relative_eq!(fix.position, at.xy(), epsilon = 1e-5);
        }
    }
}

/// The covariance is true: squared errors in its measure average the two dimensions they have.
#[test]
fn the_covariance_is_the_error() {
    let mut rng = Rng::new(13);
    let (mut sum, rounds) = (0.0, 4_000);
    for _ in 0..rounds {
        let at = Point3::new(rng.range(1.0, 7.0), rng.range(1.0, 6.0), 1.0);
        let mut ranges = exact(&beacons(), &at);
        for (k, range) in ranges.iter_mut().enumerate() {
            range.sigma = 0.01 * (k + 1) as f64;
            range.distance += rng.normal() * range.sigma;
        }
        let fix = trilaterate(&ranges, at.z).unwrap();
        let error = fix.position - at.xy();
        sum += error.dot(&(fix.covariance.try_inverse().unwrap() * error));
    }
    // The mean of 4000 values of chi-squared with 2 degrees: 2 ± 4 · 2/√4000.
    assert!((sum / f64::from(rounds) - 2.0).abs() < 0.13, "{}", sum / f64::from(rounds));
}

/// P92: as the paper says, radio is simple and its error high; it grows with the noise.
#[test]
fn the_error_grows_with_the_noise_of_the_radio() {
    let median_error = |sigma_db: f64| {
        let model = PathLoss { sigma_db, ..PathLoss::default() };
        let mut rng = Rng::new(14);
        let mut errors: Vec<f64> = (0..400)
            .filter_map(|_| {
                let at = Point3::new(rng.range(1.0, 7.0), rng.range(1.0, 6.0), 1.0);
                let ranges: Vec<Range> = beacons()[..3]
                    .iter()
                    .map(|&beacon| {
                        let strength = model.strength((at - beacon).norm());
                        model.range(beacon, strength + sigma_db * rng.normal())
                    })
                    .collect();
                Some((trilaterate(&ranges, at.z).ok()?.position - at.xy()).norm())
            })
            .collect();
        assert!(errors.len() > 350, "nearly all are fixed: {}", errors.len());
        volery_geometry::median(&mut errors).unwrap()
    };
    let errors = [0.5, 1.0, 2.0, 4.0].map(median_error);
    assert!(errors.windows(2).all(|pair| pair[1] > 1.5 * pair[0]), "{errors:?}");
    assert!(errors[3] > 0.5, "half a meter and more at 4 dB: {errors:?}");
}

/// What does not fix a position is refused.
#[test]
fn degenerate_layouts_are_refused() {
    let at = Point3::new(2.0, 3.0, 1.0);
    let two = exact(&beacons()[..2], &at);
    assert_eq!(trilaterate(&two, 1.0), Err(FixError::TooFewRanges { got: 2 }));
    let line: Vec<_> = (0..4).map(|k| Point3::new(f64::from(k), 2.0 * f64::from(k), 2.0)).collect();
    assert_eq!(trilaterate(&exact(&line, &at), 1.0), Err(FixError::Collinear));
    let same = vec![Point3::new(1.0, 1.0, 2.0); 3];
    assert_eq!(trilaterate(&exact(&same, &at), 1.0), Err(FixError::Collinear));
    for change in [
        |r: &mut Range| r.distance = f64::NAN,
        |r: &mut Range| r.distance = -1.0,
        |r: &mut Range| r.sigma = 0.0,
        |r: &mut Range| r.beacon.x = f64::INFINITY,
    ] {
        let mut ranges = exact(&beacons(), &at);
        change(&mut ranges[1]);
        assert_eq!(trilaterate(&ranges, 1.0), Err(FixError::NotFinite));
    }
    assert_eq!(trilaterate(&exact(&beacons(), &at), f64::NAN), Err(FixError::NotFinite));
}

/// P93: height from light and a place in the plane make three dimensions; a table beneath is taken
/// for the floor and lifts the height's error, not the place.
#[test]
fn a_table_disturbs_the_height_only() {
    let at = Point3::new(3.0, 3.0, 1.6);
    let plane = trilaterate(&exact(&beacons()[..3], &at), at.z).unwrap();
    let fix = with_height(&plane, 0.0, 1.6, 0.02).unwrap();
    assert_relative_eq!(fix.position, at, epsilon = 1e-5);
    assert_relative_eq!(fix.covariance[(2, 2)], 4e-4, epsilon = 1e-12);
    let over_table = with_height(&plane, 0.0, 1.6 - 0.75, 0.02).unwrap();
    assert_relative_eq!(over_table.position - at, Vector3::new(0.0, 0.0, -0.75), epsilon = 1e-5);
    assert_eq!(with_height(&plane, 0.0, f64::NAN, 0.02), Err(FixError::NotFinite));
    assert_eq!(with_height(&plane, 0.0, -0.1, 0.02), Err(FixError::NotFinite));
}
