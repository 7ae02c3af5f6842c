//! Rendered rooms and flights with exact ground truth.
//!
//! World: meters, right-handed, z up, the floor at z = 0, the middle of the floor at the origin.
//! Headings are radians clockwise from +y, as telemetry reports them. The same seed gives the same
//! scene on every machine and for any number of threads.

pub mod flight;
pub mod points;
pub mod rng;
pub mod room;

pub use flight::{CenterMotion, along_wall, cam_from_heading, circle, random_walk, ring, yaw_scan};
pub use points::{PointOptions, PointScene, paper_camera};
pub use rng::Rng;
pub use room::{Cuboid, Room, SurfacePoint};
