//! Pictures into a localization stream of the server.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use nalgebra::Isometry3;
use tokio::sync::mpsc::UnboundedSender;
use uuid::Uuid;
use volery_client::api::ws::{FrameHeader, StreamMode, StreamOpen};
use volery_client::api::{Camera, LocalizeStatus};
use volery_client::{Client, ClientError, StreamAnswer};

use super::Line;
use super::feed::Pictures;
use super::report::{Placed, camera_pose, rounded};

/// Wait before a lost stream is opened again.
const REOPEN: Duration = Duration::from_secs(1);

/// The server and the map that drones are looked for in.
#[derive(Debug, Clone)]
pub struct StreamTarget {
    /// With a token that may localize.
    pub client: Client,
    /// Map.
    pub map_id: Uuid,
    /// Intrinsics of the cameras.
    pub camera: Camera,
}

/// Sends each new picture of a drone; a stream that ends is opened again.
pub(super) async fn stream_frames(
    target: StreamTarget,
    system_id: u8,
    mut pictures: Pictures,
    says: UnboundedSender<Line>,
    start: Instant,
) {
    let say = |frame: String, placed: Option<Box<Placed>>| {
        let t = rounded(start.elapsed().as_secs_f64());
        // Nobody listens any more when the run has ended.
        let _ = says.send(Line::Frame { t, system_id, frame, placed });
    };
    loop {
        match pump(&target, system_id, &mut pictures, &say).await {
            Ok(()) => return,
            Err(error) => say(format!("error: {error}"), None),
        }
        tokio::time::sleep(REOPEN).await;
    }
}

/// Until the camera is gone (`Ok`) or the stream.
async fn pump(
    target: &StreamTarget,
    system_id: u8,
    pictures: &mut Pictures,
    say: &impl Fn(String, Option<Box<Placed>>),
) -> Result<(), ClientError> {
    let open = StreamOpen {
        map_id: target.map_id,
        version: None,
        camera: Some(target.camera.clone()),
        mode: StreamMode::Latest,
        track: true,
        drone_id: Some(system_id.to_string()),
        feed: true,
    };
    let mut stream = target.client.open_stream(open).await?;
    let mut seq = 0;
    let mut asked: BTreeMap<u64, (Duration, Isometry3<f64>)> = BTreeMap::new();
    loop {
        tokio::select! {
            answer = stream.next() => match answer? {
                StreamAnswer::Result { answer, .. } => {
                    say(name_of(answer.localization.status).to_owned(), None);
                }
                StreamAnswer::Tracked { seq, frame, .. } => {
                    // Those before it were answered or pushed out.
                    let later = asked.split_off(&(seq + 1));
                    let truth = std::mem::replace(&mut asked, later).remove(&seq);
                    let placed = truth.zip(frame.pose).map(|((taken, world_from_camera), pose)| {
                        Box::new(Placed {
                            taken: rounded(taken.as_secs_f64()),
                            truth: camera_pose(&world_from_camera),
                            pose,
                            server_ms: frame.latency.total_ms,
                        })
                    });
                    say(format!("{:?}", frame.state).to_lowercase(), placed);
                }
                StreamAnswer::Dropped { reason, .. } => say(format!("dropped: {reason}"), None),
            },
            changed = pictures.changed() => {
                if changed.is_err() {
                    return Ok(());
                }
                let Some(picture) = pictures.borrow_and_update().clone() else { continue };
                let header = FrameHeader {
                    stream_id: 0,
                    seq,
                    t_capture_ns: Some(picture.captured_ns),
                    encoding: Default::default(),
                    width: None,
                    height: None,
                    prior: None,
                    telemetry: None,
                };
                asked.insert(seq, (picture.taken, picture.world_from_camera));
                stream.send_frame(&header, &picture.jpeg).await?;
                seq += 1;
            }
        }
    }
}

fn name_of(status: LocalizeStatus) -> &'static str {
    match status {
        LocalizeStatus::Ok => "ok",
        LocalizeStatus::Ambiguous => "ambiguous",
        LocalizeStatus::NotFound => "not_found",
    }
}
