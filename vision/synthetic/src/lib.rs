//! Rendered rooms and flights with exact ground truth.
//!
//! World: meters, right-handed, z up, the floor at z = 0, the middle of the floor at the origin.
//! Headings are radians clockwise from +y, as telemetry reports them. The same seed gives the same
//! scene for any number of threads.
//!
//! Two kinds of scenes: [`PointScene`] has keypoints and matches without images, to test the
//! stages behind matching; [`Hall`] is painted and rendered, to test all of them.

mod canvas;
pub mod demo;
pub mod flight;
pub mod hall;
mod light;
pub mod paint;
pub mod points;
pub mod render;
pub mod room;
pub mod sensor;
mod surfaces;
pub mod telemetry;
pub mod texture;
mod tiles;
pub mod zones;

pub use demo::{DemoHall, Shot};
pub use flight::{CenterMotion, along_wall, cam_from_heading, circle, random_walk, ring, yaw_scan};
pub use hall::Hall;
pub use points::{PointOptions, PointScene, paper_camera};
pub use render::{Renderer, Rendering};
pub use room::{Cuboid, Room, SurfacePoint};
pub use sensor::{Photo, Sensor};
pub use telemetry::{TelemetryNoise, telemetry, telemetry_csv};
pub use volery_geometry::{Rng, rng};
pub use zones::{ScanOptions, Zone};
