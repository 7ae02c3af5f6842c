//! HTTP: a handler parses, calls, answers.

pub(crate) mod beacons;
pub(crate) mod cameras;
pub(crate) mod drone_cameras;
pub(crate) mod drones;
pub(crate) mod exports;
mod files;
pub(crate) mod flights;
pub(crate) mod frames;
pub(crate) mod images;
pub(crate) mod imagesets;
mod ingest;
pub(crate) mod job_log;
pub(crate) mod jobs;
pub(crate) mod leases;
pub(crate) mod localize;
pub(crate) mod maps;
pub(crate) mod model;
pub(crate) mod page;
pub(crate) mod parts;
pub(crate) mod priors;
pub(crate) mod recordings;
pub(crate) mod render;
pub(crate) mod service;
pub(crate) mod tokens;
pub(crate) mod uploads;
mod zip_directory;
mod zips;

pub(crate) use localize::localize_in;
