//! The service as its clients meet it: one program, since each would compile the server again.

mod access;
mod all_stop;
mod archives;
mod audit;
mod connections;
mod crash;
mod disk_full;
mod drones;
mod flights;
mod idempotency;
mod independent_drones;
mod jobs;
mod leases;
mod maps;
mod mavlink_peers;
mod parts;
mod pulled_cameras;
mod recordings;
mod socket;
mod support;
mod targets;
mod uploads;
