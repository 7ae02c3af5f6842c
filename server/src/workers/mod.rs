//! Child processes: whatever touches untrusted bytes or much memory runs in one.

mod pool;
mod process;

pub(crate) use pool::{Pool, PoolError};
pub(crate) use process::{command, confine, kill_group, stop_group};
