//! What is known of images before they are looked at.

use std::{collections::BTreeMap, sync::Arc};

use axum::{
    Json,
    body::Bytes,
    extract::{FromRequest, Request, State},
};
use uuid::Uuid;
use volery_api::{AttitudePrior, HeightPrior, Prior, PriorsReport, PutPriors};

use crate::{
    auth::Mapper,
    error::{ApiError, ApiResult, Code},
    extract::{At, body_error, media_type, parse_json},
    state::App,
};

/// Sigmas of telemetry, which reports none: a compass indoors, an attitude filter, a range finder.
const SIGMA_YAW_DEG: f64 = 3.0;
const SIGMA_TILT_DEG: f64 = 1.0;
const SIGMA_HEIGHT_M: f64 = 0.05;

/// Sets the priors of images, by name.
///
/// A JSON body is `PutPriors`. A `text/csv` body is telemetry:
/// `image,time_s,yaw_deg,pitch_deg,roll_deg,height_m`, columns in any order, all but `image`
/// optional.
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
        Some("text/csv") => {
            let text = std::str::from_utf8(&bytes)
                .map_err(|error| ApiError::new(Code::BadRequest, error.to_string()))?;
            parse_telemetry(text)
                .map_err(|detail| ApiError::new(Code::Unprocessable("bad_telemetry"), detail))?
        }
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

fn parse_telemetry(text: &str) -> Result<BTreeMap<String, Prior>, String> {
    let mut lines = text.lines().filter(|line| !line.trim().is_empty() && !line.starts_with('#'));
    let header: Vec<_> = lines.next().ok_or("no header line")?.split(',').map(str::trim).collect();
    let known = ["image", "time_s", "yaw_deg", "pitch_deg", "roll_deg", "height_m"];
    if let Some(unknown) = header.iter().find(|name| !known.contains(*name)) {
        return Err(format!("unknown column {unknown:?}"));
    }
    let image = header.iter().position(|name| *name == "image").ok_or("no column `image`")?;
    let mut priors = BTreeMap::new();
    for (number, line) in lines.enumerate() {
        let cells: Vec<_> = line.split(',').map(str::trim).collect();
        if cells.len() != header.len() {
            return Err(format!("row {}: {} cells, not {}", number + 1, cells.len(), header.len()));
        }
        let number_in = |column: &str| -> Result<Option<f64>, String> {
            let Some(at) = header.iter().position(|name| *name == column) else { return Ok(None) };
            if cells[at].is_empty() {
                return Ok(None);
            }
            let value: f64 = cells[at]
                .parse()
                .map_err(|_| format!("row {}: {:?} is no number", number + 1, cells[at]))?;
            Ok(Some(value))
        };
        let attitude = number_in("yaw_deg")?.map(|yaw| -> Result<_, String> {
            Ok(AttitudePrior {
                yaw: yaw.to_radians(),
                pitch: number_in("pitch_deg")?.unwrap_or(0.0).to_radians(),
                roll: number_in("roll_deg")?.unwrap_or(0.0).to_radians(),
                sigma_yaw: SIGMA_YAW_DEG.to_radians(),
                sigma_tilt: SIGMA_TILT_DEG.to_radians(),
            })
        });
        let prior = Prior {
            attitude: attitude.transpose()?,
            height: number_in("height_m")?
                .map(|height| HeightPrior { height, sigma: SIGMA_HEIGHT_M }),
            time_s: number_in("time_s")?,
            ..Prior::default()
        };
        priors.insert(cells[image].to_owned(), prior);
    }
    Ok(priors)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn telemetry_becomes_priors() {
        let text = "image,time_s,yaw_deg,height_m\na.jpg,1.5,90,2\nb.jpg,2,,\n";
        let priors = parse_telemetry(text).unwrap();
        let a = &priors["a.jpg"];
        assert!((a.attitude.unwrap().yaw - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        assert_eq!(a.height.unwrap().height, 2.0);
        assert_eq!(priors["b.jpg"], Prior { time_s: Some(2.0), ..Prior::default() });
    }

    #[test]
    fn odd_telemetry_is_named() {
        for text in ["", "time_s\n1", "image,speed\na,1", "image,time_s\na", "image,time_s\na,x"] {
            assert!(parse_telemetry(text).is_err(), "{text:?}");
        }
    }
}
