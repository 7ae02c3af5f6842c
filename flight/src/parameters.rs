//! What an autopilot must be set to before it flies by camera, and whether one is.

mod inspection;
mod inspector;
mod rules;

pub use inspection::{Finding, Inspection};
pub use inspector::{Inspected, Inspector};
pub use rules::{Rule, Wanted, rules};
