//! Time per stage and accuracy on every set.
