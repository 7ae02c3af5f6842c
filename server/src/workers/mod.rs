//! Child processes: whatever touches untrusted bytes or much memory runs in one.

mod child;
mod pool;
mod process;
mod seats;

pub(crate) use pool::{Pool, PoolError};
pub(crate) use process::{command, confine, kill_group, stop_group};
pub(crate) use seats::{Seat, Seats, Turn};
