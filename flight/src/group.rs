//! Several vehicles in one space: formations, the plan and its check, the flight of the plan.

mod assignment;
mod deconfliction;
mod formation;
mod geofence;
mod plan;
mod separation;

pub use assignment::assign;
pub use deconfliction::{Deconfliction, Task, Unplannable, deconflict};
pub use formation::Formation;
pub use geofence::{Breach, Geofence, GeofenceError, Prism};
pub use plan::{FlightPlan, Rules, Violation};
pub use separation::{Approach, Separation, closest_approach};
