//! What is known of images before they are looked at.

use std::{collections::BTreeMap, sync::Arc};

use axum::{
    Json,
    body::Bytes,
    extract::{FromRequest, Request, State},
};
use uuid::Uuid;
use volery_api::{AttitudePrior, HeightPrior, PositionPrior, Prior, PriorsReport, PutPriors};
use volery_formats::{TelemetrySigmas, read_telemetry_csv};
use volery_scene::ImagePrior;

use crate::{
    auth::Mapper,
    error::{ApiError, ApiResult, Code},
    extract::{At, body_error, media_type, parse_json},
    state::App,
};

/// Sets the priors of images, by name.
///
/// A JSON body is `PutPriors`. A `text/csv` body is telemetry:
/// `image,time_s,yaw_deg,pitch_deg,roll_deg,height_m,x_m,y_m,z_m`, columns in any order, all but
/// `image` optional; an attitude needs its three angles, a position its three coordinates.
#[utoipa::path(put, path = "/v1/imagesets/{id}/priors", tag = "image sets",
    params(("id" = Uuid, Path, description = "Of the image set")),
    request_body(content((PutPriors = "application/json"), (String = "text/csv"))),
    responses((status = 200, description = "What became of them", body = PriorsReport)))]
pub(crate) async fn put_priors(
    State(app): State<Arc<App>>,
    _caller: Mapper,
    At(id): At<Uuid>,
    request: Request,
) -> ApiResult<Json<PriorsReport>> {
    app.store.imageset(id).await?;
    let kind = media_type(request.headers());
    let bytes = Bytes::from_request(request, &()).await.map_err(body_error)?;
    let priors = match kind.as_deref() {
        Some("application/json") => parse_json::<PutPriors>(&bytes)?.priors,
        Some("text/csv") => telemetry(&bytes)?,
        _ => {
            return Err(ApiError::new(
                Code::UnsupportedMediaType,
                "the body must be application/json or text/csv",
            ));
        }
    };
    for (name, prior) in &priors {
        check_prior(prior)
            .map_err(|error| ApiError { detail: format!("{name}: {}", error.detail), ..error })?;
    }
    Ok(Json(app.store.put_priors(id, &priors).await?))
}

/// A prior that makes sense.
pub(super) fn check_prior(prior: &Prior) -> ApiResult<()> {
    match prior.problem() {
        None => Ok(()),
        Some(problem) => Err(ApiError::new(Code::Unprocessable("bad_prior"), problem)),
    }
}

/// Telemetry as priors, by image name.
fn telemetry(bytes: &[u8]) -> ApiResult<BTreeMap<String, Prior>> {
    let rows = read_telemetry_csv(bytes, &TelemetrySigmas::default())
        .map_err(|error| ApiError::new(Code::Unprocessable("bad_telemetry"), error.to_string()))?;
    Ok(rows.into_iter().map(|row| (row.image, prior(&row.prior))).collect())
}

fn prior(known: &ImagePrior) -> Prior {
    Prior {
        attitude: known.attitude.map(|attitude| AttitudePrior {
            yaw: attitude.yaw,
            pitch: attitude.pitch,
            roll: attitude.roll,
            sigma_yaw: attitude.sigma_yaw,
            sigma_tilt: attitude.sigma_tilt,
        }),
        height: known.height.map(|known| HeightPrior { height: known.height, sigma: known.sigma }),
        position: known
            .position
            .map(|known| PositionPrior { position: known.position.into(), sigma: known.sigma }),
        time_s: known.time_s,
        ..Prior::default()
    }
}
