//! Start and end of the service.

use std::{
    fs::{File, TryLockError},
    net::SocketAddr,
    sync::Arc,
    time::Duration,
};

use futures_util::future::BoxFuture;
use tokio::{net::TcpListener, task::JoinHandle};
use volery_api::Role;

use crate::{
    accept, app,
    audit::{Audit, write_down},
    auth::{hash_secret, new_secret},
    config::Config,
    error::{ApiError, ApiResult},
    jobs,
    state::App,
};

/// Age at which a file that nothing refers to is deleted: no upload takes as long.
const BLOB_AGE: Duration = Duration::from_secs(24 * 3600);
/// So long it is known who did what.
const AUDIT_AGE: Duration = Duration::from_secs(90 * 24 * 3600);
/// Uploads in parts that are older are given up.
const UPLOAD_AGE: Duration = Duration::from_secs(3 * 24 * 3600);

/// Why the service does not run.
#[derive(Debug, thiserror::Error)]
pub enum ServeError {
    /// Another service works on the same data folder.
    #[error("another service uses the data folder {0}")]
    FolderInUse(std::path::PathBuf),
    /// The address cannot be had.
    #[error("cannot listen on {0}: {1}")]
    Listen(SocketAddr, std::io::Error),
    /// Loopback without a token on an address that others can reach.
    #[error("requests without a token are for loopback only, not for {0}")]
    OpenToOthers(SocketAddr),
    /// The data folder cannot be used.
    #[error("cannot open the data folder: {0}")]
    Data(String),
}

impl From<ApiError> for ServeError {
    fn from(error: ApiError) -> Self {
        Self::Data(error.detail)
    }
}

impl From<std::io::Error> for ServeError {
    fn from(error: std::io::Error) -> Self {
        Self::Data(error.to_string())
    }
}

/// A service that runs until [`RunningServer::stop`].
#[derive(Debug)]
pub struct RunningServer {
    /// Where it listens.
    pub addr: SocketAddr,
    /// The secret of the first admin token; only at the first start over a data folder.
    pub admin_token: Option<String>,
    app: Arc<App>,
    tasks: Vec<JoinHandle<()>>,
    /// Held as long as the folder is in use.
    lock: File,
}

impl RunningServer {
    /// Its address for clients.
    pub fn url(&self) -> String {
        format!("http://{}", self.addr)
    }

    /// Where drones are heard, if they are.
    pub fn mavlink_addr(&self) -> Option<SocketAddr> {
        self.app.drones.as_ref().map(|drones| drones.address())
    }

    /// Closes down: running jobs are put back into the queue.
    pub async fn stop(self) {
        self.app.closing.cancel();
        for task in self.tasks {
            // A task that panicked has been reported.
            let _ = task.await;
        }
        self.app.sources.close();
        if let Some(drones) = &self.app.drones {
            drones.close();
        }
        self.app.store.close().await;
        // Closing the file is not enough: a process that is just being started holds a copy.
        if let Err(error) = self.lock.unlock() {
            tracing::warn!("cannot unlock the data folder: {error}");
        }
    }
}

/// Opens the data folder, listens and works, in the background.
///
/// Boxed, so that the service is compiled here and not once more with whoever starts it.
pub fn start(config: Config) -> BoxFuture<'static, Result<RunningServer, ServeError>> {
    Box::pin(open(config))
}

async fn open(config: Config) -> Result<RunningServer, ServeError> {
    if config.loopback_without_token && !config.listen.ip().is_loopback() {
        return Err(ServeError::OpenToOthers(config.listen));
    }
    std::fs::create_dir_all(&config.data)?;
    let config = Config { data: std::fs::canonicalize(&config.data)?, ..config };
    let lock = File::create(config.data.join("lock"))?;
    match lock.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => return Err(ServeError::FolderInUse(config.data)),
        Err(TryLockError::Error(error)) => return Err(error.into()),
    }
    let listen = config.listen;
    let listener =
        TcpListener::bind(listen).await.map_err(|error| ServeError::Listen(listen, error))?;
    let addr = listener.local_addr()?;
    let (audit, audited) = Audit::new();
    let app = App::open(config, audit).await?;
    let recovered = app.store.recover_jobs().await?;
    if recovered > 0 {
        tracing::info!("{recovered} jobs go on where the last service left them");
    }
    app.sources.resume(&app).await?;
    let admin_token = first_token(&app).await?;
    let router = app::router(Arc::clone(&app));
    let tasks = vec![
        tokio::spawn(accept::accept(listener, router, Arc::clone(&app))),
        tokio::spawn(jobs::run_jobs(Arc::clone(&app))),
        tokio::spawn(clean_up(Arc::clone(&app))),
        tokio::spawn(write_down(Arc::clone(&app), audited)),
    ];
    tracing::info!(%addr, "listening on {addr}");
    Ok(RunningServer { addr, admin_token, app, tasks, lock })
}

/// Frees the space of what was deleted, once an hour.
async fn clean_up(app: Arc<App>) {
    let mut hour = tokio::time::interval(Duration::from_secs(3600));
    loop {
        tokio::select! {
            _ = hour.tick() => {}
            () = app.closing.cancelled() => return,
        }
        if let Err(error) = app.store.forget_old_audit(AUDIT_AGE).await {
            tracing::warn!(error = %error.detail, "cannot delete old entries of the audit");
        }
        if let Err(error) = app.store.forget_old_uploads(&app.upload_files, UPLOAD_AGE).await {
            tracing::warn!(error = %error.detail, "cannot delete old uploads");
        }
        if let Err(error) = app.drop_stale_map_folders().await {
            tracing::warn!(error = %error.detail, "cannot delete old map folders");
        }
        match app.store.collect_blobs(&app.blobs, BLOB_AGE).await {
            Ok(0) => {}
            Ok(deleted) => tracing::info!("deleted {deleted} files that nothing refers to"),
            Err(error) => tracing::warn!(error = %error.detail, "cannot delete old files"),
        }
    }
}

async fn first_token(app: &App) -> ApiResult<Option<String>> {
    if app.store.has_tokens().await? {
        return Ok(None);
    }
    let secret = new_secret()?;
    app.store.insert_token("first", Role::Admin, &hash_secret(&secret), None).await?;
    Ok(Some(secret))
}
