//! Async client of a Volery server.
