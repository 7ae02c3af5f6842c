//! A localization as the API says it.

use volery_api::{Localization, LocalizeStatus, LocalizeTimings, PhotoLight, RenderScore, Rival};
use volery_localization::{PoseEstimate, Status};

use crate::{map_folder::Located, wire};

/// The answer in the words of the API. `decode_ms` and `total_ms` are for the caller to add.
pub fn localization(located: &Located) -> Localization {
    let (answer, timings) = (&located.answer, &located.timings);
    let mut reply = not_found("");
    reply.num_features = answer.num_features as u32;
    reply.method = Some(located.method);
    reply.render_score = located.score.map(|score| RenderScore {
        agreement: score.agreement,
        correlation: score.correlation,
        num_patches: score.num_patches as u32,
        seen: score.seen,
    });
    reply.light = located.light.map(|light| PhotoLight {
        gain: light.gain,
        gamma: light.gamma,
        sharpness: light.sharpness,
        is_blurred: light.is_blurred(),
        is_other_light: light.is_other(),
    });
    reply.num_correspondences = answer.num_correspondences as u32;
    reply.timings = LocalizeTimings {
        decode_ms: None,
        features_ms: finite(timings.features_ms),
        match_ms: finite(timings.match_ms),
        solve_ms: finite(timings.solve_ms),
        total_ms: None,
    };
    match &answer.status {
        Status::Ok(estimate) => {
            reply.status = LocalizeStatus::Ok;
            reply.reason = None;
            reply.pose = Some(wire::camera_pose(&estimate.map_from_camera));
            reply.covariance = Some(estimate.covariance.transpose().iter().copied().collect());
            add_support(&mut reply, estimate);
        }
        Status::Ambiguous(estimates) => {
            reply.status = LocalizeStatus::Ambiguous;
            reply.reason = Some("ambiguous".to_owned());
            reply.rivals = estimates
                .iter()
                .map(|e| Rival {
                    pose: wire::camera_pose(&e.map_from_camera),
                    num_inliers: e.num_inliers as u32,
                })
                .collect();
            if let Some(best) = estimates.first() {
                add_support(&mut reply, best);
            }
        }
        Status::NotFound(reason) => reply.reason = Some(reason.code().to_owned()),
    }
    reply
}

/// The answer to an image that was not even looked at.
pub fn not_found(reason: &str) -> Localization {
    Localization {
        status: LocalizeStatus::NotFound,
        pose: None,
        covariance: None,
        reason: Some(reason.to_owned()),
        rivals: Vec::new(),
        num_features: 0,
        num_correspondences: 0,
        num_inliers: 0,
        inlier_ratio: None,
        reprojection_px: None,
        method: None,
        render_score: None,
        light: None,
        timings: LocalizeTimings::default(),
    }
}

fn add_support(reply: &mut Localization, estimate: &PoseEstimate) {
    reply.num_correspondences = estimate.num_correspondences as u32;
    reply.num_inliers = estimate.num_inliers as u32;
    reply.inlier_ratio = finite(estimate.inlier_ratio());
    reply.reprojection_px = finite(estimate.reprojection_px);
}

fn finite(value: f64) -> Option<f64> {
    value.is_finite().then_some(value)
}
