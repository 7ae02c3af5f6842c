//! The service as a user meets it: the program itself, over REST, with real workers.

#[path = "../support/mod.rs"]
mod support;

mod bad_input;
mod cancel;
mod commands;
mod crash;
mod demo;
mod goal_frame;
mod journey;
mod live_pose;
mod pulled_cameras;
mod resume;
mod server;
mod surface;
mod surface_crash;
