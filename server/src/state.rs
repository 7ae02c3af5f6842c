//! What every request can reach.

use std::{path::PathBuf, sync::Arc};

use tokio::sync::{Notify, Semaphore};
use tokio_util::sync::CancellationToken;
use uuid::Uuid;
use volery_api::MapVersion;

use crate::{
    audit::Audit,
    auth::Guard,
    config::Config,
    error::{ApiError, ApiResult, Code},
    fleet::Drones,
    idempotency::Answers,
    metrics::Metrics,
    pictures::Pictures,
    poses::Poses,
    sources::Sources,
    store::{Store, UploadFiles, blobs::Blobs},
    workers::{Pool, Seats},
};

/// Uploaded files held in memory at once.
const MAX_HELD_FILES: usize = 4;

/// The service.
#[derive(Debug)]
pub(crate) struct App {
    pub(crate) config: Config,
    pub(crate) store: Store,
    pub(crate) blobs: Blobs,
    pub(crate) upload_files: UploadFiles,
    pub(crate) guard: Guard,
    pub(crate) metrics: Metrics,
    pub(crate) audit: Audit,
    /// To requests that had a key.
    pub(crate) answers: Answers,
    pub(crate) decoders: Pool,
    pub(crate) localizers: Pool,
    /// Localizers that follow streams.
    pub(crate) trackers: Seats,
    /// Of drones, by their cameras.
    pub(crate) poses: Poses,
    /// Of drones' cameras.
    pub(crate) pictures: Pictures,
    /// Cameras that are pulled.
    pub(crate) sources: Sources,
    pub(crate) held_files: Semaphore,
    /// None when the service has no link to drones.
    pub(crate) drones: Option<Drones>,
    /// Woken when a job was queued.
    pub(crate) job_queued: Notify,
    /// Woken when a running job was asked to stop.
    pub(crate) job_cancelled: Notify,
    pub(crate) closing: CancellationToken,
    /// Names this process in leases.
    pub(crate) instance: Uuid,
}

impl App {
    /// Opens the data folder.
    pub(crate) async fn open(config: Config, audit: Audit) -> ApiResult<Arc<Self>> {
        std::fs::create_dir_all(config.data.join("jobs"))?;
        let blobs = Blobs::open(&config.data, config.limits.disk_reserve_bytes)?;
        let store = Store::open(&config.data.join("volery.db")).await?;
        let drones = match &config.mavlink {
            None => None,
            Some(settings) => {
                let drones = Drones::open(settings, &config.data).map_err(ApiError::internal)?;
                for (id, drone) in store.drones().await? {
                    drones.register(id, drone);
                }
                Some(drones)
            }
        };
        let limits = &config.workers;
        Ok(Arc::new(Self {
            drones,
            decoders: Pool::new(&config, "run-decoder", limits.decoders, limits.decoder_bytes),
            localizers: Pool::new(
                &config,
                "run-localizer",
                limits.localizers,
                limits.localizer_bytes,
            ),
            trackers: Seats::new(&config, "run-localizer", limits.trackers, limits.localizer_bytes),
            poses: Poses::default(),
            pictures: Pictures::default(),
            sources: Sources::default(),
            held_files: Semaphore::new(MAX_HELD_FILES),
            job_queued: Notify::new(),
            job_cancelled: Notify::new(),
            closing: CancellationToken::new(),
            instance: Uuid::now_v7(),
            guard: Guard::default(),
            metrics: Metrics::default(),
            audit,
            answers: Answers::default(),
            upload_files: UploadFiles::open(&config.data)?,
            config,
            store,
            blobs,
        }))
    }

    /// The link to drones, if the service has one.
    pub(crate) fn drones(&self) -> ApiResult<&Drones> {
        self.drones.as_ref().ok_or_else(|| {
            ApiError::new(Code::Conflict("no_mavlink"), "the service has no link to drones")
                .hint("start it with --mavlink")
        })
    }

    /// Work folder of a job.
    pub(crate) fn job_folder(&self, job: Uuid) -> PathBuf {
        self.config.data.join("jobs").join(job.to_string())
    }

    /// The folder of a map version, for programs that read files.
    pub(crate) async fn map_folder(&self, version: &MapVersion) -> ApiResult<PathBuf> {
        let maps = self.config.data.join("maps").join(version.map_id.to_string());
        let folder = maps.join(version.version.to_string());
        if !folder.exists() {
            let (blobs, files, target) =
                (self.blobs.clone(), version.files.clone(), folder.clone());
            tokio::task::spawn_blocking(move || blobs.lay_out(&files, &target)).await??;
        }
        Ok(folder)
    }

    /// Deletes what programs have read of a map that is gone. Whoever has a file open keeps it.
    pub(crate) async fn drop_map_folder(&self, map: Uuid) {
        let folder = self.config.data.join("maps").join(map.to_string());
        if let Err(error) = tokio::fs::remove_dir_all(&folder).await
            && error.kind() != std::io::ErrorKind::NotFound
        {
            tracing::warn!(map = %map, %error, "cannot delete the folder of map {map}");
        }
    }

    /// Deletes folders of maps that are gone: a crash or a question on its way may leave one.
    pub(crate) async fn drop_stale_map_folders(&self) -> ApiResult<()> {
        let mut folders = match tokio::fs::read_dir(self.config.data.join("maps")).await {
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(()),
            folders => folders?,
        };
        while let Some(folder) = folders.next_entry().await? {
            let name = folder.file_name();
            if let Some(map) = name.to_str().and_then(|name| Uuid::parse_str(name).ok())
                && !self.store.has_map(map).await?
            {
                self.drop_map_folder(map).await;
            }
        }
        Ok(())
    }

    /// Runs blocking work on the blobs.
    pub(crate) async fn with_blobs<T: Send + 'static>(
        &self,
        work: impl FnOnce(&Blobs) -> std::io::Result<T> + Send + 'static,
    ) -> ApiResult<T> {
        let blobs = self.blobs.clone();
        let result = tokio::task::spawn_blocking(move || work(&blobs)).await?;
        result.map_err(ApiError::from)
    }
}
