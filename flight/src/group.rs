//! Several vehicles in one space: formations, the plan and its check, the flight of the plan.

mod air;
mod assignment;
mod conductor;
mod coordinator;
mod deconfliction;
mod formation;
mod geofence;
mod guard;
mod plan;
mod separation;

pub use air::{Air, Obstruction};
pub use assignment::assign;
pub use conductor::{BeginRefused, Conductor, sight};
pub use coordinator::{
    Coordinator, FlightEvent, FlightOptions, FlightState, Order, Seen, StartRefused, Tick,
};
pub use deconfliction::{Deconfliction, Task, Unplannable, deconflict};
pub use formation::Formation;
pub use geofence::{Breach, Geofence, GeofenceError, Prism};
pub use guard::{Guard, Intent, Neighbor, guard};
pub use plan::{FlightPlan, Rules, Violation};
pub use separation::{Approach, Separation, closest_approach};
