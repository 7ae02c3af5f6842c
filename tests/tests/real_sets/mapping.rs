//! Maps against surveyed or motion-capture truth.

use volery_tests::{Alignment, Evaluation, evaluate};

use crate::{DESK, FOUNTAIN, MappedSet};

/// With all photos placed.
fn figures(mapped: &MappedSet, alignment: Alignment) -> Evaluation {
    assert_eq!(mapped.summary.num_registered, mapped.set.images.len());
    let figures = evaluate(&mapped.poses, &mapped.set.truth, alignment).unwrap();
    println!("{}: {figures}", mapped.set.name);
    figures
}

/// COLMAP: 11/11, 3.0 mm over a row of 14.7 m, 0.03 degrees.
#[test]
fn fountain_is_mapped_to_millimeters() {
    let Some(fountain) = &*FOUNTAIN else { return };
    let figures = figures(fountain, Alignment::Centers);
    assert!(figures.ate_rmse <= 0.0045, "{figures}");
    assert!(figures.rotation_median_deg <= 0.06, "{figures}");
    // Photos tell no lengths.
    assert!(!fountain.summary.scale.metric);
}

/// A distorted lens, 0.44 m of path. COLMAP: all placed, 7 mm, 0.26 degrees.
#[test]
fn desk_is_mapped_through_a_distorted_lens() {
    let Some(desk) = &*DESK else { return };
    let figures = figures(desk, Alignment::Orientations);
    assert!(figures.ate_rmse <= 0.02, "{figures}");
    assert!(figures.rotation_median_deg <= 1.0, "{figures}");
}
