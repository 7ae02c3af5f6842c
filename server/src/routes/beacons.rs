//! Positions by beacons: what vision is compared with.

use axum::Json;
use volery_api::{BeaconEstimate, BeaconEstimateRequest, BeaconReading};
use volery_flight::positioning::{FixError, PathLoss, Range, trilaterate, with_height};

use crate::{
    auth::Viewer,
    error::{ApiError, ApiResult, Code},
    extract::Body,
};

/// Standard deviation of a measured distance, where none is told. Meters.
const RANGE_SIGMA: f64 = 0.05;
/// Of a height measured by light. Meters.
const HEIGHT_SIGMA: f64 = 0.02;

/// The position that explains readings of beacons best: with their strengths as radio does it, with
/// distances as sound does it, with a measured height in three dimensions.
#[utoipa::path(post, path = "/v1/beacons/estimate", tag = "beacons",
    request_body = BeaconEstimateRequest,
    responses((status = 200, description = "The position", body = BeaconEstimate)))]
pub(crate) async fn estimate(
    _caller: Viewer,
    Body(request): Body<BeaconEstimateRequest>,
) -> ApiResult<Json<BeaconEstimate>> {
    let model = request.path_loss.map_or_else(PathLoss::default, |model| PathLoss {
        at_1_m: model.at_1_m,
        exponent: model.exponent,
        sigma_db: model.sigma_db,
    });
    let range = |reading: &BeaconReading| match (reading.rssi_dbm, reading.range_m) {
        (Some(strength), None) => Ok(model.range(reading.beacon.into(), strength)),
        (None, Some(distance)) => {
            let sigma = reading.sigma_m.unwrap_or(RANGE_SIGMA);
            Ok(Range { beacon: reading.beacon.into(), distance, sigma })
        }
        _ => Err(ApiError::new(
            Code::Unprocessable("bad_reading"),
            "a reading has either `rssi_dbm` or `range_m`",
        )),
    };
    let ranges = request.readings.iter().map(range).collect::<ApiResult<Vec<_>>>()?;
    let count = ranges.len().max(1) as f64;
    let beacons_height = ranges.iter().map(|range| range.beacon.z).sum::<f64>() / count;
    let measured = request.height_tof_m.map(|down| request.floor + down);
    let z = measured.or(request.height).unwrap_or(beacons_height);
    let failed =
        |error: FixError| ApiError::new(Code::Unprocessable(error.code()), error.to_string());
    let plane = trilaterate(&ranges, z).map_err(failed)?;
    let Some(down) = request.height_tof_m else {
        let position = plane.position.iter().copied().collect();
        let sigma = plane.covariance.diagonal().iter().map(|v| v.sqrt()).collect();
        return Ok(Json(BeaconEstimate { position, sigma }));
    };
    let fix = with_height(&plane, request.floor, down, HEIGHT_SIGMA).map_err(failed)?;
    let position = fix.position.iter().copied().collect();
    let sigma = fix.covariance.diagonal().iter().map(|v| v.sqrt()).collect();
    Ok(Json(BeaconEstimate { position, sigma }))
}
