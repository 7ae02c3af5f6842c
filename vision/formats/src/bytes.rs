//! Bounds-checked reading of bytes.
