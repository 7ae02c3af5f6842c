//! States, commands and alerts of drones to a socket.

use std::sync::Arc;

use tokio::sync::broadcast::{Receiver, error::RecvError};
use uuid::Uuid;
use volery_api::{DroneAlert, DroneState, FlightNews, ws::ServerBody};

use super::connection::Outbox;
use crate::{
    error::{ApiError, ApiResult, Code},
    fleet::{DroneNews, States},
    state::App,
    streams::Gone,
    task::Task,
};

/// What happens in flights that somebody should look at.
const FLIGHT_ALERTS: [&str; 3] = ["held", "taken_out", "no_way"];

/// Sends what a topic of drones is about until the returned task is dropped; `None` when the topic
/// is about something else.
pub(super) fn subscribe(app: &Arc<App>, outbox: &Outbox, topic: &str) -> ApiResult<Option<Task>> {
    let (kind, which) = topic.split_once(':').unwrap_or((topic, ""));
    let (outbox, topic) = (outbox.clone(), topic.to_owned());
    Ok(Some(match (kind, which) {
        ("alerts", "") => {
            let drones = app.drones()?;
            let flights = drones.read_flights(|flights, _, _| flights.listen());
            let news = drones.listen();
            until_gone(alerts(news, flights, outbox, topic))
        }
        ("drone", which) => {
            let only = match which {
                "*" => None,
                id => Some(id.parse::<u8>().map_err(|_| {
                    let detail = "a drone is named by its system id: `drone:7`";
                    ApiError::new(Code::Unprocessable("bad_topic"), detail)
                })?),
            };
            let drones = app.drones()?;
            let (states, news) = (drones.watch(only), drones.listen());
            until_gone(follow(states, news, only, outbox, topic))
        }
        _ => return Ok(None),
    }))
}

fn until_gone(run: impl Future<Output = Result<(), Gone>> + Send + 'static) -> Task {
    Task(tokio::spawn(async move {
        // The connection notices that this task has ended.
        let _ = run.await;
    }))
}

/// States and commands of one drone, or of all.
async fn follow(
    mut states: States,
    mut news: Receiver<DroneNews>,
    only: Option<u8>,
    outbox: Outbox,
    topic: String,
) -> Result<(), Gone> {
    let concerns = |drone: u8| only.is_none_or(|only| only == drone);
    loop {
        tokio::select! {
            fresh = states.next() => {
                for state in fresh.ok_or(Gone)? {
                    // A client that reads slowly gets fewer of them.
                    outbox.wait().await?;
                    let (topic, state) = (topic.clone(), Box::new(DroneState::clone(&state)));
                    outbox.send(None, ServerBody::DroneState { topic, state })?;
                }
            }
            event = news.recv() => match event {
                Ok(DroneNews::Command(command)) if concerns(command.drone) => {
                    let topic = topic.clone();
                    outbox.send(None, ServerBody::CommandState { topic, command })?;
                }
                Ok(_) => {}
                Err(error) => lost(error, &outbox, &topic)?,
            },
        }
    }
}

/// What somebody should look at, of drones and of flights.
async fn alerts(
    mut news: Receiver<DroneNews>,
    mut flights: Receiver<(Uuid, FlightNews)>,
    outbox: Outbox,
    topic: String,
) -> Result<(), Gone> {
    loop {
        let alert = tokio::select! {
            event = news.recv() => match event {
                Ok(DroneNews::Alert(alert)) => Some(alert),
                Ok(_) => None,
                Err(error) => lost(error, &outbox, &topic).map(|()| None)?,
            },
            event = flights.recv() => match event {
                Ok((flight, news)) => flight_alert(flight, &news),
                Err(error) => lost(error, &outbox, &topic).map(|()| None)?,
            },
        };
        if let Some(alert) = alert {
            outbox.send(None, ServerBody::Alert { topic: topic.clone(), alert })?;
        }
    }
}

fn flight_alert(flight: Uuid, news: &FlightNews) -> Option<DroneAlert> {
    FLIGHT_ALERTS.contains(&news.kind.as_str()).then_some(())?;
    Some(DroneAlert {
        drone: news.drone?,
        flight_id: Some(flight),
        t_ns: news.t_ns,
        code: news.value.clone().unwrap_or_else(|| news.kind.clone()),
        detail: Some(news.kind.clone()),
    })
}

fn lost(error: RecvError, outbox: &Outbox, topic: &str) -> Result<(), Gone> {
    match error {
        RecvError::Lagged(_) => outbox.send(None, ServerBody::Resync { topic: topic.to_owned() }),
        RecvError::Closed => Err(Gone),
    }
}
