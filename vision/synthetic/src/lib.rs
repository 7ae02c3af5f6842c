//! Rendered rooms and flights with exact ground truth.
