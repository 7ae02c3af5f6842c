use volery_geometry::Rng;

use super::*;

/// An L-shaped hall, 6 m long and 4 m wide, without its corner beyond (3, 2), with a pillar.
fn hall() -> Geofence {
    let outline = [(0.0, 0.0), (6.0, 0.0), (6.0, 2.0), (3.0, 2.0), (3.0, 4.0), (0.0, 4.0)];
    let area = Prism {
        outline: outline.map(|(x, y)| Point2::new(x, y)).to_vec(),
        floor: 0.0,
        ceiling: 3.0,
    };
    let low = Point3::new(1.0, 1.0, 0.0);
    let pillar = Prism::between(&low, &Point3::new(1.5, 1.5, 1.0));
    Geofence::new(area, vec![pillar], 0.3).unwrap()
}

#[test]
fn every_wall_has_its_margin() {
    let hall = hall();
    let breach = |x, y, z| hall.breach(&Point3::new(x, y, z));
    assert_eq!(breach(0.31, 0.31, 0.31), None);
    assert_eq!(breach(0.29, 2.0, 1.5), Some(Breach::Outside));
    assert_eq!(breach(-1.0, 2.0, 1.5), Some(Breach::Outside));
    assert_eq!(breach(2.0, 2.0, 0.29), Some(Breach::BelowFloor));
    assert_eq!(breach(2.0, 2.0, 2.71), Some(Breach::AboveCeiling));
    assert_eq!(breach(4.0, 3.0, 1.5), Some(Breach::Outside), "the missing corner");
    assert_eq!(breach(1.2, 1.2, 0.8), Some(Breach::KeepOut(0)));
    assert_eq!(breach(1.2, 1.2, 1.29), Some(Breach::KeepOut(0)), "above, within the margin");
    assert_eq!(breach(1.2, 1.2, 1.31), None);
    assert_eq!(breach(1.79, 1.2, 0.5), Some(Breach::KeepOut(0)));
    assert_eq!(breach(1.81, 1.2, 0.5), None);
    assert_eq!(breach(f64::NAN, 1.0, 1.0), Some(Breach::Outside));
}

/// A line breaks the fence if and only if one of its points does.
#[test]
fn a_line_is_judged_by_all_its_points() {
    let hall = hall();
    let mut rng = Rng::new(7);
    let mut broken = 0;
    for _ in 0..2_000 {
        let mut place =
            || Point3::new(rng.range(0.3, 5.7), rng.range(0.3, 3.7), rng.range(0.3, 2.7));
        let (a, b) = (place(), place());
        let sampled = (0..=1_000)
            .map(|k| a + (b - a) * (f64::from(k) / 1_000.0))
            .any(|p| hall.breach(&p).is_some());
        let exact = hall.breach_between(&a, &b);
        // What a sample finds the line must find; what only the line finds must be marginal.
        if sampled {
            assert!(exact.is_some(), "{a} {b}");
            broken += 1;
        } else if exact.is_some() {
            let slightly = Geofence { margin: hall.margin - 1e-3, ..hall.clone() };
            assert!(slightly.breach_between(&a, &b).is_none(), "{a} {b} {exact:?}");
        }
    }
    assert!((500..1_800).contains(&broken), "both kinds occur: {broken}");
}

/// Both ends of a line around the corner are inside, the line is not.
#[test]
fn a_line_across_the_corner_leaves_the_hall() {
    let hall = hall();
    let (a, b) = (Point3::new(2.5, 3.6, 2.0), Point3::new(5.6, 1.5, 2.0));
    assert_eq!((hall.breach(&a), hall.breach(&b)), (None, None));
    assert_eq!(hall.breach_between(&a, &b), Some(Breach::Outside));
}

/// A thin wall is not flown through, however thin, even without a margin.
#[test]
fn nothing_passes_through_a_thin_wall() {
    let room = Prism::between(&Point3::origin(), &Point3::new(4.0, 4.0, 3.0));
    let wall = Prism::between(&Point3::new(2.0, 0.0, 0.0), &Point3::new(2.001, 4.0, 3.0));
    let fence = Geofence::new(room, vec![wall], 0.0).unwrap();
    let (a, b) = (Point3::new(1.0, 2.0, 1.0), Point3::new(3.0, 2.5, 1.5));
    assert_eq!(fence.breach_between(&a, &b), Some(Breach::KeepOut(0)));
}

#[test]
fn wrong_fences_are_refused() {
    let (low, high) = (Point3::origin(), Point3::new(1.0, 1.0, 1.0));
    let flat = Point3::new(1.0, 1.0, 0.0);
    assert_eq!(Geofence::around(&low, &flat, 0.0), Err(GeofenceError::NoHeight));
    assert_eq!(Geofence::around(&low, &high, 0.5), Err(GeofenceError::Margin));
    assert_eq!(Geofence::around(&low, &high, -0.1), Err(GeofenceError::Margin));
    assert_eq!(Geofence::around(&low, &high, f64::NAN), Err(GeofenceError::NotFinite));
    let nan = Point3::new(f64::NAN, 1.0, 1.0);
    assert_eq!(Geofence::around(&low, &nan, 0.1), Err(GeofenceError::NotFinite));
    let prism = |corners: &[(f64, f64)]| Prism {
        outline: corners.iter().map(|&(x, y)| Point2::new(x, y)).collect(),
        floor: 0.0,
        ceiling: 1.0,
    };
    let fence = |corners| Geofence::new(prism(corners), Vec::new(), 0.1);
    assert_eq!(fence(&[(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)]), Err(GeofenceError::NoArea));
    assert_eq!(fence(&[(0.0, 0.0), (1.0, 0.0)]), Err(GeofenceError::NoArea));
    let bow_tie = [(0.0, 0.0), (2.0, 2.0), (2.0, 0.0), (0.0, 1.0)];
    assert!(matches!(fence(&bow_tie), Err(GeofenceError::Crossing { first: 0, second: 2 })));
}
