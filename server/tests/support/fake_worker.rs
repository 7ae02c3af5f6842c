//! A worker that plays its part from a script.
fn main() {}
