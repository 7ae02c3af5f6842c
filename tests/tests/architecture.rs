//! The invariants of `ARCHITECTURE.md` that a program can check.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde_json::Value;
use volery_tests::repository::{cargo_metadata, repository_root};
use volery_tests::source::{blank_comments_and_literals, has_token, rust_files, without_tests};

/// What pure code does not say: files, sockets, processes, clocks, the environment, prints,
/// waiting, globals that change.
const IMPURE: &[&str] = &[
    "std::fs",
    "std::net",
    "std::env",
    "std::process",
    "std::os",
    "env!",
    "option_env!",
    "Instant",
    "SystemTime",
    "println!",
    "eprintln!",
    "print!",
    "eprint!",
    "dbg!",
    "stdout",
    "stderr",
    "stdin",
    "tokio",
    "async",
    "await",
    "thread::sleep",
    "thread::spawn",
    "thread_local!",
    "static mut",
    "OnceLock",
    "OnceCell",
    "LazyLock",
    "AtomicBool",
    "AtomicUsize",
    "AtomicU64",
    "AtomicU32",
    "thread_rng",
    "RandomState",
];

/// Every crate of ours in the order of the data, with what it may use. A crate may use ours only
/// from the lines above it: nothing flows back.
const ALLOWED: &[(&str, &[&str])] = &[
    ("volery-geometry", &["nalgebra", "serde", "thiserror"]),
    ("volery-scene", &["volery-geometry", "nalgebra", "serde", "thiserror"]),
    ("volery-features", &["volery-geometry", "volery-scene", "nalgebra", "rayon", "thiserror"]),
    (
        "volery-estimation",
        &["volery-geometry", "volery-scene", "nalgebra", "faer", "rayon", "arrayvec", "thiserror"],
    ),
    (
        "volery-sfm",
        &[
            "volery-geometry",
            "volery-scene",
            "volery-features",
            "volery-estimation",
            "nalgebra",
            "faer",
            "rayon",
            "thiserror",
        ],
    ),
    ("volery-mvs", &["volery-geometry", "volery-scene", "nalgebra", "rayon", "thiserror"]),
    (
        "volery-registration",
        &["volery-geometry", "volery-scene", "volery-estimation", "nalgebra", "rayon", "thiserror"],
    ),
    ("volery-meshing", &["volery-geometry", "volery-scene", "nalgebra", "rayon", "thiserror"]),
    ("volery-rendering", &["volery-geometry", "volery-scene", "nalgebra", "rayon", "thiserror"]),
    (
        "volery-localization",
        &[
            "volery-geometry",
            "volery-scene",
            "volery-features",
            "volery-estimation",
            "volery-rendering",
            "nalgebra",
            "faer",
            "thiserror",
        ],
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
            "kamadak-exif",
            "serde",
            "serde_json",
            "thiserror",
        ],
    ),
    ("volery-synthetic", &["volery-geometry", "volery-scene", "nalgebra", "rayon"]),
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
            "volery-api",
            "axum",
            "bytes",
            "futures-util",
            "getrandom",
            "http-body-util",
            "hyper",
            "hyper-util",
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
            "volery-localization",
            "volery-formats",
            "volery-synthetic",
            "volery-api",
            "volery-pipeline",
            "volery-server",
            "volery-client",
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
            "volery-tests",
            "nalgebra",
            "rayon",
            "rustix",
            "serde_json",
            "time",
        ],
    ),
];

/// Licenses that ask for no more than their notice.
const PERMISSIVE: &[&str] = &[
    "0BSD",
    "Apache-2.0",
    "Apache-2.0 WITH LLVM-exception",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "BSL-1.0",
    "CC0-1.0",
    "CDLA-Permissive-2.0",
    "ISC",
    "MIT",
    "MIT-0",
    "Unicode-3.0",
    "Unicode-DFS-2016",
    "Unlicense",
    "Zlib",
];

/// Files of pure crates with their code, tests cut out.
fn pure_code() -> Vec<(String, String)> {
    let root = repository_root();
    let mut all = Vec::new();
    for folder in ["vision", "flight"] {
        for file in rust_files(&root.join(folder)) {
            let path = file.strip_prefix(&root).unwrap_or(&file);
            let in_src = path.components().any(|part| part.as_os_str() == "src");
            if in_src && !is_test(path) {
                let source = std::fs::read_to_string(&file).unwrap();
                let code = without_tests(&blank_comments_and_literals(&source));
                all.push((path.display().to_string(), code));
            }
        }
    }
    assert!(all.len() > 30, "the sources were not found");
    all
}

/// `tests.rs`, `test_scene.rs` and what lies in a folder of tests.
fn is_test(path: &Path) -> bool {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    stem == "tests" || stem.starts_with("test_") || path.iter().any(|part| part == "tests")
}

fn complaints(code: &str, path: &str, tokens: &[&str]) -> Vec<String> {
    let mut found = Vec::new();
    for (number, line) in code.lines().enumerate() {
        for token in tokens.iter().filter(|token| has_token(line, token)) {
            found.push(format!("{path}:{}: `{token}`", number + 1));
        }
    }
    found
}

/// Bytes, time, seeds and progress are arguments.
#[test]
fn pure_crates_are_pure() {
    let found: Vec<_> =
        pure_code().iter().flat_map(|(path, code)| complaints(code, path, IMPURE)).collect();
    assert!(found.is_empty(), "impure code:\n{}", found.join("\n"));
}

#[test]
fn unsafe_code_is_only_in_simd_kernels() {
    let found: Vec<_> = pure_code()
        .iter()
        .filter(|(path, _)| !Path::new(path).iter().any(|p| p.to_string_lossy().contains("simd")))
        .flat_map(|(path, code)| complaints(code, path, &["unsafe"]))
        .collect();
    assert!(found.is_empty(), "unsafe outside of simd files:\n{}", found.join("\n"));
}

#[test]
fn pure_crates_neither_unwrap_nor_leave_gaps() {
    let tokens = [".unwrap()", "todo!", "unimplemented!"];
    let found: Vec<_> =
        pure_code().iter().flat_map(|(path, code)| complaints(code, path, &tokens)).collect();
    assert!(found.is_empty(), "outside of tests:\n{}", found.join("\n"));
}

/// A file is one idea; past 400 lines, its tests not counted, it is two.
#[test]
fn files_are_short() {
    let root = repository_root();
    let mut long = Vec::new();
    for folder in
        ["vision", "flight", "pipeline", "api", "server", "client_sdk", "cli", "tests", "benches"]
    {
        for file in rust_files(&root.join(folder)) {
            let source = std::fs::read_to_string(&file).unwrap();
            let code = without_tests(&blank_comments_and_literals(&source));
            let num_lines = code.trim_end().lines().count();
            if num_lines > 400 && !is_test(&file) {
                let path = file.strip_prefix(&root).unwrap_or(&file);
                long.push(format!("{}: {num_lines} lines", path.display()));
            }
        }
    }
    assert!(long.is_empty(), "{}", long.join("\n"));
}

fn text<'a>(value: &'a Value, key: &str) -> &'a str {
    value[key].as_str().unwrap_or_default()
}

/// SQL and HTTP status codes have their rooms in the server.
#[test]
fn words_stay_in_their_rooms() {
    let root = repository_root().join("server/src");
    let rooms: [(&str, &[&str]); 2] = [
        ("sqlx", &["store", "error.rs"]),
        ("StatusCode", &["error.rs", "answer.rs", "extract.rs", "routes/files.rs"]),
    ];
    let mut strays = Vec::new();
    for file in rust_files(&root) {
        let source = std::fs::read_to_string(&file).unwrap();
        let code = without_tests(&blank_comments_and_literals(&source));
        let path = file.strip_prefix(&root).unwrap();
        for (word, rooms) in rooms {
            if has_token(&code, word) && !rooms.iter().any(|room| path.starts_with(room)) {
                strays.push(format!("{word} in {}", path.display()));
            }
        }
    }
    assert!(strays.is_empty(), "{}", strays.join("\n"));
}

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

/// Whether an SPDX expression can be met by permissive licenses alone.
fn is_permissive(expression: &str) -> bool {
    let expression = expression.replace('/', " OR ");
    let spaced = expression.replace('(', " ( ").replace(')', " ) ");
    let mut words = spaced.split_whitespace().peekable();
    any_of(&mut words) && words.next().is_none()
}

type Words<'a> = std::iter::Peekable<std::str::SplitWhitespace<'a>>;

fn any_of(words: &mut Words) -> bool {
    let mut met = all_of(words);
    while words.next_if_eq(&"OR").is_some() {
        met |= all_of(words);
    }
    met
}

fn all_of(words: &mut Words) -> bool {
    let mut met = one(words);
    while words.next_if_eq(&"AND").is_some() {
        met &= one(words);
    }
    met
}

fn one(words: &mut Words) -> bool {
    let Some(word) = words.next() else { return false };
    if word == "(" {
        let met = any_of(words);
        return words.next() == Some(")") && met;
    }
    if words.next_if_eq(&"WITH").is_some() {
        let exception = words.next().unwrap_or_default();
        return PERMISSIVE.contains(&format!("{word} WITH {exception}").as_str());
    }
    PERMISSIVE.contains(&word)
}

#[test]
fn spdx_expressions_are_understood() {
    for good in [
        "MIT",
        "MIT/Apache-2.0",
        "GPL-3.0 OR MIT",
        "(MIT OR Apache-2.0) AND Unicode-3.0",
        "Apache-2.0 WITH LLVM-exception OR Apache-2.0 OR MIT",
        "ISC AND (Apache-2.0 OR ISC)",
    ] {
        assert!(is_permissive(good), "{good}");
    }
    for bad in ["GPL-3.0", "MIT AND GPL-3.0", "", "LGPL-2.1 OR GPL-2.0", "(MIT", "MIT)", "MIT AND"]
    {
        assert!(!is_permissive(bad), "{bad}");
    }
}

#[test]
fn licenses_of_the_whole_tree_are_permissive() {
    let metadata = cargo_metadata().unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    let foreign: Vec<String> = packages
        .iter()
        .filter(|package| !is_permissive(text(package, "license")))
        .map(|p| format!("{} {}: `{}`", text(p, "name"), text(p, "version"), text(p, "license")))
        .collect();
    assert!(foreign.is_empty(), "{}", foreign.join("\n"));
}
