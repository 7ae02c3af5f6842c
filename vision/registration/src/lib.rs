//! Partial maps (zones) to one frame.
//!
//! Two ways to a first alignment, from points that both maps know ([`align_shared_points`]) and
//! from geometry alone ([`register_anywhere`]); iterative closest points ([`icp`],
//! [`register_nearby`]); a proof of overlap ([`Overlap`]); a pose graph over many zones
//! ([`solve_pose_graph`], [`join_zones`]).

mod consistency;
mod constraint;
mod error;
mod global;
mod icp;
mod join;
mod kernel;
mod landmarks;
mod merge;
mod nearby;
mod overlap;
mod pose_graph;
mod seen_space;
mod shared_points;
mod surfels;
mod zone;

pub use constraint::{Constraint, Contact, Twist, TwistMatrix};
pub use error::{FreeDirection, RegistrationError};
pub use global::{Registration, register_anywhere, register_from};
pub use icp::{Icp, IcpOptions, Metric, icp};
pub use join::{Guess, JoinedZones, PairReport, Placement, join_zones};
pub use kernel::Kernel;
pub use merge::{PointOfPart, adjust_merged, merge_models};
pub use nearby::{NearbyOptions, register_nearby};
pub use overlap::Overlap;
pub use pose_graph::{Link, PoseGraph, solve_pose_graph};
pub use shared_points::{
    CrossMatches, SharedAlignment, agreeing_points, align_shared_points, shared_points,
};
pub use surfels::{Surfel, Surfels};
pub use zone::Zone;

#[cfg(test)]
mod test_zones;

/// Degrees of freedom of a transform.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Motion {
    /// Six: both maps have the same unit.
    #[default]
    Rigid,
    /// Seven: the scale of the source is free.
    Similarity,
}
