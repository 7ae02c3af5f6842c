//! Bytes to scene and back.
