//! A task with an owner.

use tokio::task::JoinHandle;

/// A task that ends with its handle.
#[derive(Debug)]
pub(crate) struct Task(pub(crate) JoinHandle<()>);

impl Drop for Task {
    fn drop(&mut self) {
        self.0.abort();
    }
}
