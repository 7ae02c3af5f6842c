//! The demo as its users run it.

use std::{
    fs,
    io::{BufRead, BufReader},
    process::{Command, Stdio},
};

use crate::support::{Folder, utf8, volery, volery_json};

/// What is in a folder already stays there.
#[test]
fn a_folder_of_others_is_refused() {
    let folder = Folder::new("demo-refused");
    fs::create_dir(folder.join("data")).unwrap();
    fs::write(folder.join("data/letter.txt"), "mine").unwrap();
    let output = volery(&["demo", "--headless", "--out", utf8(&folder.0)]);
    assert_eq!(output.status.code(), Some(2));
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("is not empty") && said.contains("--out"), "{said}");
    assert_eq!(fs::read(folder.join("data/letter.txt")).unwrap(), b"mine");
}

/// It tells at once where to watch it, and ends at an interrupt with a word.
#[test]
fn an_interrupt_ends_the_demo() {
    let folder = Folder::new("demo-interrupted");
    let mut demo = Command::new(env!("CARGO_BIN_EXE_volery"))
        .args(["demo", "--out", utf8(&folder.join("out"))])
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(demo.stderr.take().unwrap()).lines().map(Result::unwrap);
    let first = lines.next().unwrap();
    assert!(first.contains("http://127.0.0.1:") && first.contains("/#token="), "{first}");
    let pid = rustix::process::Pid::from_child(&demo);
    rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
    let rest: Vec<String> = lines.collect();
    assert!(rest.iter().any(|line| line.contains("interrupted")), "{rest:?}");
    assert_eq!(demo.wait().unwrap().code(), Some(1));
}

/// The hall is mapped to centimeters, and three drones fly in the map on what their cameras see.
#[test]
fn drones_fly_in_the_map_that_was_made() {
    if std::env::var_os("VOLERY_LONG").is_none() {
        eprintln!("SKIPPED: VOLERY_LONG is not set");
        return;
    }
    let folder = Folder::new("demo");
    let out = folder.join("out");
    let (report, code) = volery_json(&["demo", "--headless", "--json", "--out", utf8(&out)]);
    let figure = |name: &str| report[name].as_f64().unwrap_or(f64::NAN);
    eprintln!("{}", report["flight"]);
    assert_eq!((figure("drones"), figure("arrived"), code), (3.0, 3.0, 0));
    assert!(figure("map_ate_m") <= 0.02 && figure("pose_error_median_m") <= 0.03);
    assert!(figure("min_separation_m") >= 1.0);
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(page.contains("Group flight") && page.contains("<polyline"));
}
