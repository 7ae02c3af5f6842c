//! Tracks the frames of a flight with known poses.
//!
//! `flight MAP/localization.bin FLIGHT [--twice] [--csv FILE]`: FLIGHT holds the frames, `camera.json`,
//! `telemetry.csv` and `ground_truth.csv`. With `--twice`, frames are doubled in size. Times are of
//! the processor: set `RAYON_NUM_THREADS=1`.

use std::path::{Path, PathBuf};
use std::time::Duration;

use volery_formats::{
    DecodeLimits, TelemetrySigmas, decode_image, read_camera_json, read_poses_csv,
    read_telemetry_csv,
};
use volery_localization::LocalizationIndex;
use volery_scene::GrayImage;
use volery_tracking::{Frame, Telemetry, TrackState, Tracker, TrackerOptions};

fn read(path: &Path) -> Vec<u8> {
    std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

fn percentile(values: &mut [f64], part: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let at = ((values.len() as f64 * part) as usize).min(values.len().saturating_sub(1));
    values.get(at).copied().unwrap_or(f64::NAN)
}

/// Seconds of the processor that this thread has used: other work on the machine does not count.
fn clock() -> f64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    now.tv_sec as f64 + now.tv_nsec as f64 * 1e-9
}

/// Twice as wide and high.
fn doubled(image: &GrayImage) -> GrayImage {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let at = |x: isize, y: isize| {
        let x = x.clamp(0, width as isize - 1) as u32;
        let y = y.clamp(0, height as isize - 1) as u32;
        f32::from(image.row(y)[x as usize])
    };
    let pixels = (0..4 * width * height).map(|k| {
        let (x, y) = ((k % (2 * width)) as isize, (k / (2 * width)) as isize);
        let (i, j) = ((x - 1).div_euclid(2), (y - 1).div_euclid(2));
        let a = if x % 2 == 0 { 0.75 } else { 0.25 };
        let b = if y % 2 == 0 { 0.75 } else { 0.25 };
        let top = at(i, j) * (1.0 - a) + at(i + 1, j) * a;
        let bottom = at(i, j + 1) * (1.0 - a) + at(i + 1, j + 1) * a;
        (top * (1.0 - b) + bottom * b).round() as u8
    });
    GrayImage::new(2 * image.width(), 2 * image.height(), pixels.collect()).expect("one each")
}

fn main() {
    let mut arguments: Vec<String> = std::env::args().skip(1).collect();
    let twice = arguments.iter().position(|a| a == "--twice").map(|at| arguments.remove(at));
    let csv = arguments.iter().position(|a| a == "--csv").map(|at| {
        arguments.remove(at);
        arguments.remove(at)
    });
    let flight = PathBuf::from(&arguments[1]);
    let index = LocalizationIndex::from_bytes(&read(Path::new(&arguments[0]))).expect("an index");
    let mut camera = read_camera_json(&read(&flight.join("camera.json"))).expect("a camera");
    if twice.is_some() {
        camera = camera.scaled(2.0, 2 * camera.width, 2 * camera.height);
    }
    let truth = read_poses_csv(&read(&flight.join("ground_truth.csv"))).expect("poses");
    let told =
        read_telemetry_csv(&read(&flight.join("telemetry.csv")), &TelemetrySigmas::default())
            .expect("telemetry");
    let mut tracker = Tracker::new(&camera, &TrackerOptions::default());
    let (mut shifts, mut turns, mut nees) = (Vec::new(), Vec::new(), Vec::new());
    let (mut times, mut no_pose) = (Vec::new(), 0);
    let mut rows =
        String::from("image,state,source,points,reason,x,y,z,error_m,error_deg,sigma_m,ms\n");
    for volery_formats::TelemetryRow { image: name, prior } in &told {
        let Some(truth) = truth.iter().find(|pose| pose.image == *name) else { continue };
        let mut image = decode_image(&read(&flight.join(name)), &DecodeLimits::default())
            .expect("a photo")
            .gray;
        if twice.is_some() {
            image = doubled(&image);
        }
        let telemetry = Telemetry {
            heading: prior.attitude.map(|a| (a.yaw, a.sigma_yaw)),
            height: prior.height.map(|h| (h.height, h.sigma)),
            velocity: None,
        };
        let capture_time = Duration::from_secs_f64(prior.time_s.expect("a time"));
        let frame = Frame { image: &image, capture_time, telemetry };
        let answer = tracker.track(&frame, &index, &clock);
        tracker.catch_up(&index, false);
        let t = answer.timings;
        times.push(t.sum_ms());
        let reason = [answer.fault.map(|f| f.code()), answer.problem.map(|p| p.code())];
        let reason: Vec<&str> = reason.into_iter().flatten().collect();
        let steps = format!(
            "{:.1} = {:.1} track {:.1} features {:.1} match {:.1} solve",
            t.sum_ms(),
            t.track_ms,
            t.features_ms,
            t.match_ms,
            t.solve_ms
        );
        let Some(pose) = answer.pose else {
            assert!(answer.state != TrackState::Tracking);
            no_pose += 1;
            rows +=
                &format!("{name},{},,,{},,,,,,,{steps}\n", answer.state.code(), reason.join(" "));
            continue;
        };
        let found = pose.map_from_camera;
        let shift = found.translation.vector - truth.world_from_cam.translation.vector;
        let turn = (found.rotation * truth.world_from_cam.rotation.inverse()).scaled_axis();
        let e = nalgebra::Vector6::new(shift.x, shift.y, shift.z, turn.x, turn.y, turn.z);
        nees.push(pose.covariance.cholesky().map_or(f64::NAN, |c| e.dot(&c.solve(&e))));
        shifts.push(shift.norm());
        turns.push(turn.norm().to_degrees());
        let at = found.translation.vector;
        let sigma = pose.covariance.fixed_view::<3, 3>(0, 0).trace().sqrt();
        rows += &format!(
            "{name},{},{},{},{},{:.4},{:.4},{:.4},{:.4},{:.3},{sigma:.4},{steps}\n",
            answer.state.code(),
            pose.source.code(),
            pose.num_points,
            reason.join(" "),
            at.x,
            at.y,
            at.z,
            shift.norm(),
            turn.norm().to_degrees(),
        );
    }
    for (what, values) in
        [("m", &mut shifts), ("degrees", &mut turns), ("NEES", &mut nees), ("ms", &mut times)]
    {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let [p50, p95, most] = [0.5, 0.95, 1.0].map(|part| percentile(values, part));
        println!("{what}: median {p50:.4}, p95 {p95:.4}, most {most:.4}, mean {mean:.4}");
    }
    println!("{no_pose} frames without a pose");
    match csv {
        Some(file) => std::fs::write(file, rows).expect("written"),
        None => print!("{rows}"),
    }
}
