//! The verdict over what could not be mapped at all.

use volery_scene::{Quality, QualityReason, UnplacedImage, UnplacedReason, Verdict};

/// The verdict when there is no map: why most images have no place.
pub(crate) fn no_map(unplaced: &[UnplacedImage]) -> Quality {
    let count = |reason| unplaced.iter().filter(|image| image.reason == reason).count();
    let (turned, alone) = (count(UnplacedReason::NoParallax), count(UnplacedReason::NoOverlap));
    let reason = if turned > 0 && turned >= alone {
        QualityReason {
            code: UnplacedReason::NoParallax.code().to_owned(),
            detail: format!(
                "the camera only turned between {turned} images: move it sideways by at least a \
                 tenth of the distance to the scene"
            ),
        }
    } else if alone > 0 {
        QualityReason {
            code: UnplacedReason::NoOverlap.code().to_owned(),
            detail: format!(
                "{alone} images share nothing with any other: let neighbors overlap by half"
            ),
        }
    } else {
        QualityReason {
            code: UnplacedReason::Ambiguous.code().to_owned(),
            detail: "the matches fit no single scene".to_owned(),
        }
    };
    Quality { verdict: Verdict::Failed, reasons: vec![reason] }
}
