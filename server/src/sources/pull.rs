//! Keeps a camera connected.

use std::{
    convert::Infallible,
    sync::Arc,
    time::{Duration, Instant},
};

use volery_api::ws::FrameHeader;

use super::{address::Address, failure::Failure, gauge::Gauge, pictures::Pictures};
use crate::{
    metrics::add,
    state::App,
    streams::{Permitted, Stream},
};

/// Wait after the first failure; twice as long after each one that follows.
const FIRST_WAIT: Duration = Duration::from_millis(250);
const LONGEST_WAIT: Duration = Duration::from_secs(5);
/// Wait after a failure that time alone does not mend.
const LASTING_WAIT: Duration = Duration::from_secs(10);
/// A connection with pictures that lasted so long was a good one.
const GOOD: Duration = Duration::from_secs(1);

/// A camera to be pulled.
#[derive(Debug)]
pub(super) struct Camera {
    pub(super) drone: u8,
    pub(super) address: Address,
    pub(super) stream: Permitted,
    pub(super) gauge: Gauge,
}

/// Pulls until it is dropped.
pub(super) async fn pull(app: Arc<App>, camera: Camera) {
    let (drone, host) = (camera.drone, camera.address.authority());
    let (mut wait, mut told) = (FIRST_WAIT, "");
    loop {
        let (began, frames) = (Instant::now(), camera.gauge.known().frames);
        let failure = match follow(&app, &camera).await {
            Ok(never) => match never {},
            Err(failure) => failure,
        };
        camera.gauge.failed(&failure);
        add(&app.metrics.camera_failures, 1);
        // Once for tries that fail alike.
        if std::mem::replace(&mut told, failure.code()) != failure.code() {
            tracing::warn!(drone, host, code = told, "camera of drone {drone}: {failure}");
        }
        if began.elapsed() > GOOD && camera.gauge.known().frames > frames {
            (wait, told) = (FIRST_WAIT, "");
        }
        let this = if failure.is_lasting() { LASTING_WAIT } else { wait };
        tokio::time::sleep(this.mul_f64(jitter())).await;
        wait = (wait * 2).min(LONGEST_WAIT);
    }
}

/// Cameras that failed together do not come back together: 0.75 to 1.25.
fn jitter() -> f64 {
    getrandom::u32().map_or(1.0, |random| 0.75 + 0.5 * f64::from(random) / f64::from(u32::MAX))
}

/// Sends the pictures of one connection through a stream of their own: a camera that was gone may
/// have another time, and be at another place.
async fn follow(app: &Arc<App>, camera: &Camera) -> Result<Infallible, Failure> {
    let max_bytes = app.config.limits.image_bytes as usize;
    let mut pictures = Pictures::open(&camera.address, &app.config.camera_hosts, max_bytes).await?;
    let stream = Stream::start(app, camera.stream.clone(), Box::new(camera.gauge.clone()));
    let mut before = None;
    for seq in 1.. {
        let picture = pictures.next().await?;
        let t_capture_ns = picture.t_capture_ns;
        let is_in_order = before.is_none_or(|before| match (before, t_capture_ns) {
            (Some(before), Some(now)) => before <= now,
            (before, now) => before == now,
        });
        if !is_in_order {
            return Err(Failure::Clock);
        }
        before = Some(t_capture_ns);
        camera.gauge.arrived(picture.arrived);
        add(&app.metrics.camera_frames, 1);
        let header = FrameHeader { seq, t_capture_ns, ..FrameHeader::default() };
        // The gauge does not go away.
        let _ = stream.push(header, picture.bytes, picture.arrived);
    }
    Err(Failure::Ended)
}
