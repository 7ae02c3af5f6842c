//! Which crate may use which.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;
use volery_tests::repository::cargo_metadata;

use crate::text;

/// Every crate of ours in the order of the data, with what it may use. A crate may use ours only
/// from the lines above it: nothing flows back.
const ALLOWED: &[(&str, &[&str])] = &[
    ("volery-geometry", &["nalgebra", "serde", "thiserror"]),
    ("volery-cholesky", &["faer"]),
    ("volery-scene", &["volery-geometry", "nalgebra", "serde", "thiserror"]),
    ("volery-features", &["volery-geometry", "volery-scene", "nalgebra", "rayon", "thiserror"]),
    (
        "volery-estimation",
        &[
            "volery-geometry",
            "volery-cholesky",
            "volery-scene",
            "nalgebra",
            "rayon",
            "arrayvec",
            "thiserror",
        ],
    ),
    (
        "volery-sfm",
        &[
            "volery-geometry",
            "volery-cholesky",
            "volery-scene",
            "volery-features",
            "volery-estimation",
            "nalgebra",
            "rayon",
            "thiserror",
        ],
    ),
    ("volery-mvs", &["volery-geometry", "volery-scene", "nalgebra", "rayon", "thiserror"]),
    (
        "volery-registration",
        &["volery-geometry", "volery-scene", "volery-estimation", "nalgebra", "rayon", "thiserror"],
    ),
    ("volery-rendering", &["volery-geometry", "volery-scene", "nalgebra", "rayon", "thiserror"]),
    (
        "volery-meshing",
        &["volery-geometry", "volery-scene", "volery-rendering", "nalgebra", "rayon", "thiserror"],
    ),
    (
        "volery-localization",
        &[
            "volery-geometry",
            "volery-cholesky",
            "volery-scene",
            "volery-features",
            "volery-estimation",
            "volery-rendering",
            "nalgebra",
            "thiserror",
        ],
    ),
    (
        "volery-tracking",
        &["volery-geometry", "volery-scene", "volery-features", "volery-localization", "nalgebra"],
    ),
    (
        "volery-formats",
        &[
            "volery-geometry",
            "volery-scene",
            "nalgebra",
            "png",
            "zune-core",
            "zune-jpeg",
            "jpeg-encoder",
            "kamadak-exif",
            "serde",
            "serde_json",
            "thiserror",
        ],
    ),
    ("volery-synthetic", &["volery-geometry", "volery-scene", "nalgebra", "rayon"]),
    (
        "volery-flight",
        &["volery-geometry", "volery-scene", "nalgebra", "mavlink", "sha2", "thiserror"],
    ),
    ("volery-api", &["serde", "serde_json", "uuid", "utoipa"]),
    (
        "volery-pipeline",
        &[
            "volery-geometry",
            "volery-scene",
            "volery-features",
            "volery-estimation",
            "volery-sfm",
            "volery-mvs",
            "volery-meshing",
            "volery-rendering",
            "volery-registration",
            "volery-localization",
            "volery-tracking",
            "volery-formats",
            "volery-api",
            "nalgebra",
            "rayon",
            "blake3",
            "rustix",
            "serde",
            "serde_json",
            "thiserror",
        ],
    ),
    (
        "volery-server",
        &[
            "volery-geometry",
            "volery-scene",
            "volery-formats",
            "volery-flight",
            "volery-api",
            "axum",
            "bytes",
            "flate2",
            "futures-util",
            "getrandom",
            "http-body-util",
            "hyper",
            "hyper-util",
            "nalgebra",
            "rustix",
            "serde",
            "serde_json",
            "sha2",
            "blake3",
            "sqlx",
            "subtle",
            "thiserror",
            "time",
            "tokio",
            "tokio-util",
            "tower",
            "tower-http",
            "tracing",
            "tracing-subscriber",
            "utoipa",
            "utoipa-axum",
            "uuid",
            "zip",
        ],
    ),
    (
        "volery-client",
        &[
            "volery-api",
            "reqwest",
            "tokio",
            "tokio-tungstenite",
            "futures-util",
            "serde",
            "serde_json",
            "thiserror",
            "uuid",
            "bytes",
            "sha2",
        ],
    ),
    (
        "volery-simulator",
        &[
            "volery-geometry",
            "volery-scene",
            "volery-formats",
            "volery-rendering",
            "volery-synthetic",
            "volery-api",
            "volery-client",
            "bytes",
            "futures-util",
            "mavlink",
            "nalgebra",
            "rayon",
            "reqwest",
            "rustix",
            "serde",
            "serde_json",
            "thiserror",
            "tokio",
            "uuid",
            "tokio-tungstenite",
        ],
    ),
    (
        "volery",
        &[
            "volery-geometry",
            "volery-scene",
            "volery-features",
            "volery-estimation",
            "volery-sfm",
            "volery-flight",
            "volery-localization",
            "volery-rendering",
            "volery-formats",
            "volery-synthetic",
            "volery-api",
            "volery-pipeline",
            "volery-server",
            "volery-client",
            "volery-simulator",
            "anyhow",
            "clap",
            "futures-util",
            "image",
            "indicatif",
            "nalgebra",
            "png",
            "rustix",
            "serde",
            "serde_json",
            "signal-hook",
            "time",
            "tokio",
            "tracing",
            "tracing-subscriber",
            "uuid",
            "rayon",
        ],
    ),
    (
        "volery-tests",
        &[
            "volery-geometry",
            "volery-scene",
            "volery-features",
            "volery-estimation",
            "volery-sfm",
            "volery-localization",
            "volery-formats",
            "volery-synthetic",
            "volery-pipeline",
            "nalgebra",
            "rayon",
            "serde_json",
        ],
    ),
    (
        "volery-benches",
        &[
            "volery-geometry",
            "volery-scene",
            "volery-features",
            "volery-estimation",
            "volery-sfm",
            "volery-localization",
            "volery-formats",
            "volery-synthetic",
            "volery-pipeline",
            "volery-simulator",
            "volery-tests",
            "futures-util",
            "mavlink",
            "nalgebra",
            "rayon",
            "rustix",
            "serde_json",
            "time",
            "tokio",
            "tokio-tungstenite",
        ],
    ),
];

/// Our packages with their direct dependencies (not those of tests).
fn direct_dependencies(metadata: &Value) -> BTreeMap<String, BTreeSet<String>> {
    let members: BTreeSet<&str> = metadata["workspace_members"]
        .as_array()
        .unwrap()
        .iter()
        .filter_map(Value::as_str)
        .collect();
    let packages = metadata["packages"].as_array().unwrap().iter();
    packages
        .filter(|package| members.contains(text(package, "id")))
        .map(|package| {
            let all = package["dependencies"].as_array().unwrap().iter();
            let normal = all.filter(|dependency| text(dependency, "kind") != "dev");
            let names = normal.map(|dependency| text(dependency, "name").to_owned()).collect();
            (text(package, "name").to_owned(), names)
        })
        .collect()
}

#[test]
fn crates_use_only_what_they_may() {
    let ours = direct_dependencies(&cargo_metadata().unwrap());
    let mut wrong = Vec::new();
    for (name, dependencies) in &ours {
        let Some(place) = ALLOWED.iter().position(|(known, _)| known == name) else {
            wrong.push(format!("{name} is not in the table"));
            continue;
        };
        for dependency in dependencies {
            if !ALLOWED[place].1.contains(&dependency.as_str()) {
                wrong.push(format!("{name} must not use {dependency}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    // The table itself flows one way.
    for (place, (name, allowed)) in ALLOWED.iter().enumerate() {
        for dependency in allowed.iter().filter(|d| d.starts_with("volery")) {
            let earlier = ALLOWED[..place].iter().any(|(known, _)| known == dependency);
            assert!(earlier, "{name} may not look back to {dependency}");
        }
    }
}
