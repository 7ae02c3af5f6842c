//! The commands that ask a service: their documents and exit codes.

use std::{
    fmt::Write as _,
    fs,
    path::Path,
    process::{Command, Output},
};

use serde_json::Value;

use crate::{
    server::{Scanned, Server},
    support::utf8,
};

/// Runs the program as a user does, the server and the token in the environment.
fn run(server: &Server, folder: &Path, arguments: &[&str]) -> (Option<i32>, String) {
    let output = output(server, folder, arguments);
    (output.status.code(), String::from_utf8(output.stdout).unwrap())
}

fn output(server: &Server, folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_volery"))
        .args(arguments)
        .current_dir(folder)
        .env("VOLERY_SERVER", &server.url)
        .env("VOLERY_TOKEN", &server.token)
        .output()
        .unwrap()
}

/// What a command tells off a terminal while it works: the count of a stage at the start and at
/// each tenth, in order, to its end.
fn assert_counted(told: &[u8], stage: &str, total: usize) {
    let told = String::from_utf8_lossy(told);
    let counts: Vec<usize> = told
        .lines()
        .filter_map(|line| line.strip_prefix(stage)?.strip_prefix(": ")?.split_once('/'))
        .inspect(|(_, rest)| assert!(rest.starts_with(&format!("{total} ")), "{told}"))
        .map(|(done, _)| done.parse().unwrap())
        .collect();
    assert!(counts.len() > 1 && counts.is_sorted() && counts.ends_with(&[total]), "{told}");
}

/// The document of a command that succeeds.
fn asked(server: &Server, folder: &Path, arguments: &[&str]) -> Value {
    let (code, text) = run(server, folder, &[&["--json"], arguments].concat());
    assert_eq!(code, Some(0), "{arguments:?}: {text}");
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{arguments:?}: {e}: {text}"))
}

/// The code of a command that fails.
fn refused(server: &Server, folder: &Path, arguments: &[&str]) -> String {
    let (code, text) = run(server, folder, &[&["--json"], arguments].concat());
    assert_eq!(code, Some(1), "{arguments:?}: {text}");
    let document: Value = serde_json::from_str(&text).unwrap();
    document["error"]["code"].as_str().unwrap_or_else(|| panic!("{document:#}")).to_owned()
}

#[test]
fn every_command_answers_in_json_and_by_exit_code() {
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let scanned = runtime.block_on(Scanned::new("commands"));
    let (server, folder) = (&scanned.server, &scanned.folder.0);
    let ask = |arguments: &[&str]| asked(server, folder, arguments);
    let text = |value: &Value| value.as_str().unwrap_or_else(|| panic!("{value}")).to_owned();

    let mut positions = "image,x,y,z\n".to_owned();
    for shot in &scanned.hall.scan {
        let at = shot.cam_from_world.inverse().translation.vector;
        writeln!(positions, "{},{},{},{}", shot.name, at.x, at.y, at.z).unwrap();
    }
    fs::write(folder.join("positions.csv"), positions).unwrap();
    let uploaded =
        ask(&["upload", "scan", "--positions", "positions.csv", "--position-sigma", "0.02"]);
    let num_photos = scanned.hall.scan.len();
    assert_eq!(uploaded["results"].as_array().unwrap().len(), num_photos);
    let set = text(&uploaded["imageset_id"]);
    let again = output(server, folder, &["upload", "scan", "--imageset", &set]);
    assert_counted(&again.stderr, "upload", num_photos);

    let submitted = output(
        server,
        folder,
        &[
            "--json", "jobs", "submit", &set, "--preset", "fast", "--stages", "sfm", "--name",
            "hall", "--wait",
        ],
    );
    let job: Value = serde_json::from_slice(&submitted.stdout).unwrap();
    assert_eq!(job["state"], "succeeded", "{job:#}");
    assert_counted(&submitted.stderr, "features", num_photos);
    let (id, map) = (text(&job["id"]), text(&job["outputs"]["map_id"]));
    assert_eq!(ask(&["jobs", "show", &id])["state"], "succeeded");
    assert_eq!(ask(&["jobs", "watch", &id])["id"], job["id"]);
    assert_eq!(ask(&["jobs"]).as_array().unwrap().len(), 1);
    let (code, log) = run(server, folder, &["jobs", "log", &id]);
    assert!(code == Some(0) && log.lines().count() > 3, "{log}");
    assert_eq!(refused(server, folder, &["jobs", "cancel", &id]), "job_finished");

    let shown = ask(&["maps", "show", &map]);
    // The positions went along with the photos.
    assert_eq!(shown["active"]["info"]["scale"]["source"], "positions", "{shown:#}");
    assert_eq!(ask(&["maps"])[0]["id"], shown["id"]);
    assert_eq!(ask(&["maps", "versions", &map]).as_array().unwrap().len(), 1);
    assert_eq!(refused(server, folder, &["maps", "activate", &map, "7"]), "not_found");
    assert_eq!(ask(&["maps", "activate", &map, "1"])["active_version"], 1);

    ask(&["export", &map, "poses.csv", "--out", "exported.csv"]);
    let poses = fs::read_to_string(folder.join("exported.csv")).unwrap();
    assert_eq!(poses.lines().count(), 1 + num_photos, "{poses}");
    assert_eq!(refused(server, folder, &["export", &map, "nothing.csv"]), "not_found");

    // Without --server: that of the environment. A file that is no photo has its own answer.
    fs::write(folder.join("broken.jpg"), "no photo").unwrap();
    let photo = folder.join("query").join(&scanned.hall.queries[0].name);
    let query = ["--json", "localize", "--map", &map, "broken.jpg", utf8(&photo)];
    let answered = output(server, folder, &query);
    assert_counted(&answered.stderr, "localize", 2);
    let answers: Value = serde_json::from_slice(&answered.stdout).unwrap();
    assert_eq!(answered.status.code(), Some(3), "{answers:#}");
    assert_eq!(answers["images"][0]["error"]["code"], "not_an_image", "{answers:#}");
    assert_eq!(answers["images"][1]["status"], "ok", "{answers:#}");

    ask(&["doctor"]);
    ask(&["maps", "delete", &map]);
    assert_eq!(refused(server, folder, &["maps", "show", &map]), "not_found");
    let (code, _) = run(server, folder, &["maps", "forget", &map]);
    assert_eq!(code, Some(2), "wrong usage");
}
