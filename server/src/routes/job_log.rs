//! The log of a job.

use std::{io, sync::Arc};

use axum::{
    body::Body,
    extract::State,
    http::header,
    response::{IntoResponse, Response},
};
use futures_util::stream;
use uuid::Uuid;
use volery_api::{EventsQuery, JobEvent, LogQuery};

use super::jobs::at_most;
use crate::{
    auth::Viewer,
    error::{ApiError, ApiResult, Code},
    extract::{Asked, At},
    state::App,
};

/// Weights of lines, least first.
const LEVELS: [&str; 3] = ["info", "warn", "error"];

/// Events that are read at a time.
const BATCH: u32 = 1000;

/// The whole log of a job as text, one line per entry.
#[utoipa::path(get, path = "/v1/jobs/{id}/log", tag = "jobs",
    params(LogQuery, ("id" = Uuid, Path, description = "Of the job")),
    responses((status = 200, description = "The log", body = String, content_type = "text/plain")))]
pub(crate) async fn job_log(
    State(app): State<Arc<App>>,
    _caller: Viewer,
    At(id): At<Uuid>,
    Asked(LogQuery { after, limit, level }): Asked<LogQuery>,
) -> ApiResult<Response> {
    let least = rank(level.as_deref().unwrap_or("info")).ok_or_else(|| {
        let detail = format!("levels are {}", LEVELS.join(", "));
        ApiError::new(Code::Unprocessable("bad_level"), detail)
    })?;
    if limit.is_some() {
        at_most(&EventsQuery { after, limit })?;
    }
    app.store.job(id).await?;
    let text = stream::try_unfold(Some(after.unwrap_or(0)), move |after| {
        let app = Arc::clone(&app);
        async move {
            let Some(after) = after else { return Ok::<_, io::Error>(None) };
            let events = app.store.log_events(id, after, limit.unwrap_or(BATCH)).await;
            // The client sees a broken answer, never one that only looks whole.
            let events = events.map_err(|error| io::Error::other(error.detail))?;
            let next = events.last().filter(|_| limit.is_none()).map(|event| event.seq);
            let lines: String = events.iter().filter_map(|event| line(event, least)).collect();
            Ok(Some((lines, next)))
        }
    });
    let text = Body::from_stream(text);
    Ok(([(header::CONTENT_TYPE, "text/plain; charset=utf-8")], text).into_response())
}

fn rank(level: &str) -> Option<usize> {
    LEVELS.iter().position(|known| *known == level)
}

/// What the log says of an event; `None` below the weight `least`.
fn line(JobEvent { time, kind, data, .. }: &JobEvent, least: usize) -> Option<String> {
    let field = |name: &str| data[name].as_str().unwrap_or_default();
    let (level, text) = match kind.as_str() {
        "job.log" => (field("level"), field("message").to_owned()),
        "job.state" => ("info", format!("job {}", field("state"))),
        "job.stage" => ("info", format!("stage {}", field("stage"))),
        _ => return None,
    };
    (rank(level).unwrap_or(0) >= least).then(|| format!("{time} {level} {text}\n"))
}
