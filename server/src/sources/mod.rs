//! Cameras that the service pulls: motion JPEG over HTTP, as an ESP32-CAM serves it. Each is a
//! stream that tracks for one drone, and lasts until it is deleted.

mod address;
mod failure;
mod gauge;
mod hosts;
mod multipart;
mod pictures;
mod pull;

use std::{
    collections::BTreeMap,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use volery_api::{
    DroneCamera, PutDroneCamera, Role,
    ws::{StreamMode, StreamOpen},
};

use crate::{
    error::{ApiError, ApiResult, Code},
    state::App,
    streams::{Permitted, check_system_id, permit},
    task::Task,
};
use address::Address;
use gauge::Gauge;
use hosts::may_be_allowed;
pub use hosts::{BadCameraHost, CameraHost};
use pull::{Camera, pull};

/// Cameras that are pulled at once.
const MAX_CAMERAS: usize = 32;

/// The cameras that are pulled, one per drone at most.
#[derive(Debug, Default)]
pub(crate) struct Sources {
    sources: Mutex<BTreeMap<u8, Source>>,
    /// Held while the store and the sources change together.
    changing: tokio::sync::Mutex<()>,
}

#[derive(Debug)]
struct Source {
    settings: PutDroneCamera,
    map_version: Option<u32>,
    gauge: Gauge,
    /// None when the camera cannot be pulled.
    _task: Option<Task>,
}

impl Sources {
    /// Pulls the camera of a drone from now on, also after a new start of the service.
    pub(crate) async fn put(
        &self,
        app: &Arc<App>,
        drone: u8,
        settings: PutDroneCamera,
    ) -> ApiResult<DroneCamera> {
        let _changing = self.changing.lock().await;
        let admitted = admit(app, drone, &settings).await?;
        let is_full = {
            let sources = self.lock();
            sources.len() >= MAX_CAMERAS && !sources.contains_key(&drone)
        };
        if is_full {
            let detail = format!("the service pulls at most {MAX_CAMERAS} cameras");
            return Err(ApiError::new(Code::Conflict("too_many_cameras"), detail));
        }
        app.store.put_drone_camera(drone, &settings).await?;
        let source = Source::start(app, drone, settings, admitted);
        let shown = source.shown();
        self.lock().insert(drone, source);
        Ok(shown)
    }

    /// The camera of a drone, and how the pulling goes.
    pub(crate) fn get(&self, drone: u8) -> Option<DroneCamera> {
        self.lock().get(&drone).map(Source::shown)
    }

    /// Pulls the camera of a drone no more; whether it was.
    pub(crate) async fn delete(&self, app: &App, drone: u8) -> ApiResult<bool> {
        let _changing = self.changing.lock().await;
        app.store.delete_drone_camera(drone).await?;
        Ok(self.lock().remove(&drone).is_some())
    }

    /// Goes on with the cameras that were pulled before the service was started.
    pub(crate) async fn resume(&self, app: &Arc<App>) -> ApiResult<()> {
        for (drone, settings) in app.store.drone_cameras().await? {
            let source = match admit(app, drone, &settings).await {
                Ok(admitted) => Source::start(app, drone, settings, admitted),
                Err(error) => {
                    tracing::warn!(drone, error = %error.detail, "camera of drone {drone} is not pulled");
                    let gauge = Gauge::refused(&error);
                    Source { settings, map_version: None, gauge, _task: None }
                }
            };
            self.lock().insert(drone, source);
        }
        Ok(())
    }

    /// Ends all, to be resumed.
    pub(crate) fn close(&self) {
        self.lock().clear();
    }

    fn lock(&self) -> MutexGuard<'_, BTreeMap<u8, Source>> {
        self.sources.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Checks settings as a stream is checked, and that the host may be pulled from.
async fn admit(app: &App, drone: u8, settings: &PutDroneCamera) -> ApiResult<(Address, Permitted)> {
    check_system_id(drone)?;
    let address = Address::parse(&settings.url)?;
    if !may_be_allowed(&app.config.camera_hosts, &address.host, address.port) {
        let code = Code::Unprocessable("camera_host_refused");
        let detail = format!("cameras of {} may not be pulled", address.authority());
        return Err(ApiError::new(code, detail)
            .hint(format!("start the service with --camera-host {}", address.host)));
    }
    let open = StreamOpen {
        map_id: settings.map_id,
        version: settings.version,
        camera: settings.camera.clone(),
        mode: StreamMode::Latest,
        track: true,
        drone_id: Some(drone.to_string()),
        feed: settings.feed,
    };
    Ok((address, permit(app, Role::Pilot, open).await?))
}

impl Source {
    fn start(
        app: &Arc<App>,
        drone: u8,
        settings: PutDroneCamera,
        (address, stream): (Address, Permitted),
    ) -> Self {
        let gauge = Gauge::default();
        let map_version = Some(stream.version.version);
        let camera = Camera { drone, address, stream, gauge: gauge.clone() };
        let task = Task(tokio::spawn(pull(Arc::clone(app), camera)));
        Self { settings, map_version, gauge, _task: Some(task) }
    }

    fn shown(&self) -> DroneCamera {
        let known = self.gauge.known();
        DroneCamera {
            settings: self.settings.clone(),
            map_version: self.map_version,
            state: known.state,
            frames: known.frames,
            dropped: known.dropped,
            rate_hz: known.rate_hz(),
            last_frame_age_ms: known.last_frame_age().map(|age| age.as_secs_f64() * 1e3),
            last_error: known.last_error.clone(),
        }
    }
}
