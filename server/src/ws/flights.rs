//! Events of flights to a socket.

use std::sync::Arc;

use tokio::sync::broadcast::{Receiver, error::RecvError};
use uuid::Uuid;
use volery_api::{FlightNews, ws::ServerBody};

use super::connection::Outbox;
use crate::{
    error::{ApiError, ApiResult, Code},
    state::App,
    streams::Gone,
    task::Task,
};

/// Sends the events of a flight, or of all, until the returned task is dropped; `None` when the
/// topic is about something else.
pub(super) fn subscribe(app: &Arc<App>, outbox: &Outbox, topic: &str) -> ApiResult<Option<Task>> {
    let only = match topic.split_once(':').unwrap_or((topic, "")) {
        ("flights", "") => None,
        ("flight", id) => Some(Uuid::parse_str(id).map_err(|_| {
            ApiError::new(Code::Unprocessable("bad_topic"), "a flight is named by its id")
        })?),
        _ => return Ok(None),
    };
    let drones = app.drones()?;
    let news = drones.read_flights(|flights, _, _| match only {
        Some(id) if flights.get(id).is_none() => Err(ApiError::not_found("flight", id)),
        _ => Ok(flights.listen()),
    })?;
    let (outbox, topic) = (outbox.clone(), topic.to_owned());
    Ok(Some(Task(tokio::spawn(async move {
        // The connection notices that this task has ended.
        let _ = events(news, only, outbox, topic).await;
    }))))
}

async fn events(
    mut news: Receiver<(Uuid, FlightNews)>,
    only: Option<Uuid>,
    outbox: Outbox,
    topic: String,
) -> Result<(), Gone> {
    loop {
        match news.recv().await {
            Ok((flight_id, event)) if only.is_none_or(|only| only == flight_id) => {
                let topic = topic.clone();
                outbox.send(None, ServerBody::FlightState { topic, flight_id, event })?;
            }
            Ok(_) => {}
            Err(RecvError::Lagged(_)) => {
                outbox.send(None, ServerBody::Resync { topic: topic.clone() })?;
            }
            Err(RecvError::Closed) => return Err(Gone),
        }
    }
}
