//! The invariants of `ARCHITECTURE.md` that a program can check.

mod code;
mod dependencies;
mod licenses;

use serde_json::Value;

/// A field that is text, else nothing.
fn text<'a>(value: &'a Value, key: &str) -> &'a str {
    value[key].as_str().unwrap_or_default()
}
