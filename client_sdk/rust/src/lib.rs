//! Async client of a Volery server.
//!
//! ```no_run
//! # async fn example() -> Result<(), volery_client::ClientError> {
//! use volery_client::{Client, api::CreateJob};
//!
//! let client = Client::new("http://127.0.0.1:8420", Some("token"))?;
//! let set = client.create_imageset("hall", None).await?;
//! let upload = client.upload_files(set.id, &["a.jpg".into(), "b.jpg".into()], |_, _| {}).await?;
//! let request = CreateJob { imageset_ids: vec![set.id], ..CreateJob::default() };
//! let job = client.create_job(&request).await?;
//! let job = client.watch_job(job.id, |event| println!("{}", event.kind)).await?;
//! # Ok(())
//! # }
//! ```

mod archives;
mod client;
mod drones;
mod error;
mod flights;
mod images;
mod jobs;
mod maps;
mod service;
mod socket;

pub use client::Client;
pub use error::ClientError;
pub use images::{ModelFile, UploadFile};
pub use maps::LocalizeQuery;
pub use socket::{LocalizationStream, StreamAnswer};
pub use volery_api as api;
