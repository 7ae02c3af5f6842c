//! A worker that plays its part without looking at anything: what to do stands in the bytes of
//! its inputs.
//!
//! * A photo is `\xff\xd8\xff` and words: `truncated` and `die` and `hang` are obeyed.
//! * A map of a photo named `elsewhere` knows no place, one of `inliers 7.jpg` gives so many.
//! * A map knows its free space; once it is aligned only if that was by a distance of 7 m.
//! * A job obeys words in the names of its photos: `slow`, `crash`, `refuse`, `endless`, `partial`,
//!   `late death` (after the sparse map is whole), `talkative` (more events than one answer holds).

use std::{
    collections::BTreeMap,
    fs,
    io::{self, Read, Write},
    path::Path,
    thread::sleep,
    time::Duration,
};

use nalgebra::Isometry3;
use rustix::process::{Signal, getppid, set_parent_process_death_signal};
use serde_json::{Value, json};
use volery_scene::{Occupancy, OccupancyGrid};

fn main() {
    set_parent_process_death_signal(Some(Signal::KILL)).expect("linux");
    let parent: i32 = std::env::var("VOLERY_PARENT_PID").expect("set").parse().expect("a pid");
    if getppid().map(|pid| pid.as_raw_nonzero().get()) != Some(parent) {
        return;
    }
    let mut args = std::env::args().skip(1);
    match args.next().as_deref() {
        Some("run-job") => run_job(Path::new(&args.next().expect("a folder"))),
        Some("run-decoder" | "run-localizer") => answer(),
        other => panic!("unknown word {other:?}"),
    }
}

fn say(line: Value) {
    println!("{line}");
    io::stdout().flush().expect("the parent listens");
}

fn run_job(folder: &Path) {
    let spec: Value = serde_json::from_slice(&fs::read(folder.join("job.json")).expect("job.json"))
        .expect("JSON");
    let names: Vec<_> = spec["images"]
        .as_array()
        .expect("images")
        .iter()
        .map(|image| image["name"].as_str().expect("a name").to_owned())
        .collect();
    let told = |word: &str| names.iter().any(|name| name.contains(word));
    if told("talkative") {
        for number in 0..1100 {
            say(json!({"type": "log", "level": "info", "message": format!("line {number}")}));
            // A finished stage is told at once.
            if number % 4 == 0 {
                say(json!({"type": "progress", "stage": "features", "done": 1, "total": 1,
                    "unit": "images"}));
            }
        }
        say(json!({"type": "log", "level": "error", "message": "the cause"}));
    }
    if told("refuse") {
        say(json!({"type": "result", "ok": false, "code": "no_overlap", "detail": "none",
            "hint": "take more"}));
        return;
    }
    for stage in ["features", "pairs", "matching", "mapping", "align", "export"] {
        let mut reused = 0;
        for done in 0..=names.len() {
            say(json!({"type": "progress", "stage": stage, "done": done, "total": names.len(),
                "unit": "images"}));
            // Every unit leaves a trace once, so that a resumed run can be told from a fresh one.
            let units = folder.join("cache").join(stage);
            fs::create_dir_all(&units).expect("room");
            let unit = units.join(done.to_string());
            if unit.exists() {
                reused += 1;
            } else {
                let mut log = fs::OpenOptions::new()
                    .append(true)
                    .create(true)
                    .open(folder.join("units"))
                    .expect("a log");
                writeln!(log, "{stage}-{done}").expect("room");
                if told("slow") {
                    sleep(Duration::from_millis(20));
                }
                fs::write(unit, "").expect("room");
            }
            if stage == "matching" && done == 1 {
                if told("crash") {
                    eprintln!("something terrible");
                    std::process::abort();
                }
                if told("endless") {
                    sleep(Duration::from_secs(600));
                }
            }
        }
        say(json!({"type": "reused", "stage": stage, "units": reused}));
    }
    write_map(folder, &names, &spec["maps"]);
    if told("late death") {
        std::process::abort();
    }
    say(json!({"type": "log", "level": "info", "message": "the map is written"}));
    let state = if told("partial") { "partial" } else { "succeeded" };
    let warnings = [json!({"code": "not_metric", "detail": "no unit", "hint": "measure"})];
    say(json!({"type": "result", "ok": true, "state": state, "map": "out",
        "warnings": warnings}));
}

/// `map.json` also tells how many photos came with each map that is joined.
fn write_map(folder: &Path, names: &[String], maps: &Value) {
    let photos: Vec<usize> = maps
        .as_array()
        .into_iter()
        .flatten()
        .map(|map| map["photos"].as_array().map_or(0, Vec::len))
        .collect();
    let scale = json!({"metric": false});
    let info = json!({"num_images": names.len(), "scale": scale, "photos": photos});
    let out = folder.join("out");
    fs::create_dir_all(out.join("colmap")).expect("room");
    fs::create_dir_all(out.join("zones/1")).expect("room");
    for (name, text) in [
        ("map.json", info.to_string()),
        ("poses.csv", "image,qw,qx,qy,qz,tx,ty,tz\na.jpg,1,0,0,0,1,2,3\n".to_owned()),
        ("sparse.ply", "0123456789".to_owned()),
        ("dense.ply", "many points".to_owned()),
        ("mesh.ply", "a surface".to_owned()),
        ("report.json", "{}".to_owned()),
        ("report.html", "<p>fine</p>".to_owned()),
        ("localization.bin", names.join("\n")),
        ("colmap/cameras.txt", "# cameras".to_owned()),
        ("colmap/images.txt", "# images".to_owned()),
        ("zones/1/poses.csv", "image,qw".to_owned()),
    ] {
        fs::write(out.join(name), text).expect("room");
    }
    fs::write(out.join("freespace.bin"), free_space()).expect("room");
}

/// A centimeter and half a degree.
fn small_covariance() -> Vec<f64> {
    (0..36).map(|i| if i % 7 == 0 { 1e-4 } else { 0.0 }).collect()
}

/// From -10 m to 30 m in x and y and from -2 m to 8 m in z: free air but for a pillar of half a
/// meter at (5, 0), and nobody has looked beyond x = 12 m.
fn free_space() -> Vec<u8> {
    let corner = Isometry3::translation(-10.0, -10.0, -2.0);
    let mut grid = OccupancyGrid::unseen(corner, 0.5, [80, 80, 20]).expect("a grid");
    for index in 0..grid.states().len() {
        let center = grid.center(index);
        let is_pillar = (center.x - 5.25).abs() < 0.1 && (center.y - 0.25).abs() < 0.1;
        grid.states_mut()[index] = match center.x {
            _ if is_pillar => Occupancy::Occupied,
            x if x > 12.0 => Occupancy::Unseen,
            _ => Occupancy::Free,
        };
    }
    volery_formats::write_occupancy(&grid)
}

fn read_part(input: &mut impl Read) -> Option<Vec<u8>> {
    let mut len = [0; 4];
    input.read_exact(&mut len).ok()?;
    let mut part = vec![0; u32::from_le_bytes(len) as usize];
    input.read_exact(&mut part).ok()?;
    Some(part)
}

fn answer() {
    let (mut input, mut output) = (io::stdin().lock(), io::stdout().lock());
    let mut tracked = BTreeMap::new();
    for number in 1.. {
        let Some(header) = read_part(&mut input) else { return };
        let payload = read_part(&mut input).expect("a payload");
        let request: Value = serde_json::from_slice(&header).expect("JSON");
        let mut reply = reply(&request, &payload);
        if let (Some("track"), Some(stream)) = (request["op"].as_str(), request["stream"].as_u64())
        {
            // Every answer tells how many frames of its stream this process has seen.
            let seen = tracked.entry(stream).or_insert(0_u32);
            *seen += 1;
            reply["num_points"] = json!(*seen);
        }
        let reply = serde_json::to_vec(&reply).expect("JSON");
        let picture = match request["op"].as_str() {
            Some("render") => format!("a {} picture", request["render"]["what"]),
            Some("thumbnail") => format!("{} pixels, answer {number}", request["max_side"]),
            _ => String::new(),
        };
        for part in [&reply[..], picture.as_bytes()] {
            output.write_all(&(part.len() as u32).to_le_bytes()).expect("the parent listens");
            output.write_all(part).expect("the parent listens");
        }
        output.flush().expect("the parent listens");
    }
}

fn reply(request: &Value, payload: &[u8]) -> Value {
    let told = |word: &str| payload.windows(word.len()).any(|bytes| bytes == word.as_bytes());
    if told("die") {
        std::process::abort();
    }
    if told("hang") {
        sleep(Duration::from_secs(600));
    }
    if told("truncated") {
        return json!({"ok": false, "code": "truncated", "detail": "it ends early"});
    }
    let path = |field: &str| Path::new(request[field].as_str().expect("a path")).to_owned();
    match request["op"].as_str() {
        Some("check_image") => {
            json!({"ok": true, "width": 640, "height": 480, "format": "jpeg", "exif": {}})
        }
        // The photos that the payload names have a pose, and one that is none.
        Some("read_model") if told("senseless") => {
            json!({"ok": false, "code": "bad_model", "detail": "Images file, line 1"})
        }
        Some("read_model") => {
            let photos = request["photos"].as_array().expect("names").iter();
            let photos = photos.filter_map(|name| name.as_str().filter(|name| told(name)));
            let camera = json!({"model": "PINHOLE", "width": 640, "height": 480,
                "params": [500.0, 500.0, 320.0, 240.0]});
            let pose = json!({"position": [1.0, 2.0, 3.0], "orientation": [1.0, 0.0, 0.0, 0.0]});
            let images: serde_json::Map<_, _> =
                photos.map(|name| (name.to_owned(), json!([pose, camera]))).collect();
            json!({"ok": true, "images": images, "unknown": ["z.jpg"]})
        }
        Some("thumbnail") => {
            assert!(!told("fatal when small"), "as the photo wants");
            json!({"ok": true})
        }
        Some("localize") => {
            let map = fs::read_to_string(path("map_dir").join("localization.bin"));
            let map = map.expect("the map is laid out");
            if told("slow") {
                sleep(Duration::from_millis(200));
            }
            if told("nowhere") || map.contains("elsewhere") {
                return json!({"ok": true, "status": "not_found", "reason": "too_few_matches"});
            }
            let support = map.split_once("inliers ").and_then(|(_, rest)| rest.split('.').next());
            let num_inliers: u32 = support.map_or(50, |number| number.parse().expect("a number"));
            json!({"ok": true, "status": "ok", "num_inliers": num_inliers,
                "pose": {"position": [1.0, 2.0, 3.0], "orientation": [1.0, 0.0, 0.0, 0.0]},
                "covariance": small_covariance(), "method": "pnp",
                "timings": {"features_ms": 1.0}})
        }
        Some("track") => {
            fs::metadata(path("map_dir").join("localization.bin")).expect("the map is laid out");
            if told("slow") {
                sleep(Duration::from_millis(200));
            }
            json!({"ok": true, "state": "tracking", "source": "klt", "age_ms": 0.0,
                "num_points": 0, "reset_counter": u32::from(told("reset")),
                "pose": {"position": [1.0, 2.0, 0.5], "orientation": [0.5, -0.5, 0.5, -0.5]},
                "covariance": small_covariance(),
                "latency": {"recv_ms": 0.0, "decode_ms": 1.0, "track_ms": 2.0, "features_ms": 0.0,
                    "match_ms": 0.0, "solve_ms": 0.0, "total_ms": 3.0}})
        }
        Some("end_track") => json!({"ok": true}),
        Some("render") if request["render"]["camera"]["width"] == 9999 => {
            json!({"ok": false, "code": "too_large", "detail": "too many pixels"})
        }
        Some("render") => json!({"ok": true, "surface": "mesh"}),
        Some("align") => {
            fs::create_dir_all(path("out_dir")).expect("room");
            for (name, text) in
                [("map.json", r#"{"scale":{"metric":true}}"#), ("localization.bin", "a.jpg")]
            {
                fs::write(path("out_dir").join(name), text).expect("room");
            }
            if request["align"]["known_distance"]["meters"] == 7.0 {
                fs::write(path("out_dir").join("freespace.bin"), free_space()).expect("room");
            }
            json!({"ok": true, "residuals": {"rms_m": 0.01}})
        }
        Some("export") => {
            if request["format"] == "colmap_bin" {
                fs::create_dir_all(path("out")).expect("room");
                fs::write(path("out").join("cameras.bin"), [0; 8]).expect("room");
            } else {
                fs::write(path("out"), "exported").expect("room");
            }
            json!({"ok": true})
        }
        other => json!({"ok": false, "code": "bad_request", "detail": format!("{other:?}")}),
    }
}
