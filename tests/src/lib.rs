//! Tests that cross crates, and the way to the shared data.
