//! Minimal and linear solvers.
