//! What code may say, and where; how long files are.

use std::path::Path;

use volery_tests::repository::{cargo_metadata, repository_root};
use volery_tests::source::{blank_comments_and_literals, has_token, rust_files, without_tests};

use crate::text;

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
    for folder in [
        "vision",
        "flight",
        "pipeline",
        "api",
        "server",
        "client_sdk",
        "simulator",
        "cli",
        "tests",
        "benches",
    ] {
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

/// What is not built for its unit tests (`test = false`) has none that could be forgotten.
#[test]
fn every_unit_test_is_run() {
    let metadata = cargo_metadata().unwrap();
    let root = repository_root();
    let packages = metadata["packages"].as_array().unwrap().iter();
    let targets = packages.flat_map(|package| package["targets"].as_array().unwrap());
    let mut untested = 0;
    let mut forgotten = Vec::new();
    for target in targets.filter(|target| target["test"] == false) {
        let file = Path::new(text(target, "src_path"));
        let is_code = ["lib", "bin"].iter().any(|kind| target["kind"][0] == *kind);
        if !is_code || !file.starts_with(&root) {
            continue;
        }
        untested += 1;
        for file in rust_files(file.parent().unwrap_or(file)) {
            let code = blank_comments_and_literals(&std::fs::read_to_string(&file).unwrap());
            if code.contains("#[test]") || code.contains("#[tokio::test]") {
                forgotten.push(file.display().to_string());
            }
        }
    }
    assert!(untested >= 4, "only {untested} targets without unit tests were found");
    assert!(forgotten.is_empty(), "tests that nobody runs:\n{}", forgotten.join("\n"));
}
