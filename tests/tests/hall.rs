//! A rendered hall from pixels to poses: every stage behind the decoder, against exact truth.

use volery_scene::Verdict;
use volery_tests::MappedHall;
use volery_tests::evaluation::{Alignment, Poses, evaluate, poses_of};

/// The scan of the paper (P30, P34, P35): take-off, yaw station, circle, run along the rack.
#[test]
fn the_demo_hall_is_mapped_to_a_centimeter() {
    let MappedHall { demo, reconstruction: result, .. } = MappedHall::new(1);
    let truth: Poses =
        demo.scan.iter().map(|s| (s.name.clone(), s.cam_from_world.inverse())).collect();
    let estimate = poses_of(result.models.first().expect("a map"));
    let figures = evaluate(&estimate, &truth, Alignment::Centers).unwrap();
    println!("{figures}, {:?}", result.quality.verdict);
    assert_eq!(result.quality.verdict, Verdict::Good, "{:?}", result.quality);
    assert_eq!(figures.num_registered, demo.scan.len(), "{:?}", result.unplaced);
    assert!(figures.ate_rmse <= 0.01 && figures.rotation_median_deg <= 0.1, "{figures}");
}
