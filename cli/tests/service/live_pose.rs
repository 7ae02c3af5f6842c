//! Frames of a flight in, poses out, over the socket.

use std::{collections::BTreeMap, time::Duration};

use nalgebra::{Isometry3, Quaternion, UnitQuaternion};
use uuid::Uuid;
use volery_api::{
    CreateJob, FrameTelemetry, ImageEncoding, PositionPrior, Prior, StageGroup, TrackState,
    TrackedFrame,
    ws::{FrameHeader, StreamMode, StreamOpen},
};
use volery_client::{Client, LocalizationStream, StreamAnswer};
use volery_formats::{TelemetrySigmas, read_camera_json, read_telemetry_csv};
use volery_geometry::Camera;
use volery_tests::shared::{read_poses, shared_data};

use crate::{
    server::{Photos, Server, api_camera, mapped, upload},
    support::Folder,
};

/// Between two frames.
const STEP: Duration = Duration::from_millis(100);

fn header(seq: u64, telemetry: Option<FrameTelemetry>) -> FrameHeader {
    FrameHeader {
        stream_id: 0,
        seq,
        t_capture_ns: Some(seq * STEP.as_nanos() as u64 + 1),
        encoding: ImageEncoding::Auto,
        width: None,
        height: None,
        prior: None,
        telemetry,
    }
}

async fn open(client: &Client, map_id: Uuid, camera: &Camera) -> LocalizationStream {
    let open = StreamOpen {
        map_id,
        version: None,
        camera: Some(api_camera(camera)),
        mode: StreamMode::Latest,
        track: true,
        drone_id: Some("first".to_owned()),
        feed: false,
    };
    client.open_stream(open).await.unwrap()
}

fn pose(frame: &TrackedFrame) -> Option<Isometry3<f64>> {
    let pose = frame.pose.as_ref()?;
    let [w, i, j, k] = pose.orientation;
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, i, j, k));
    Some(Isometry3::from_parts(pose.position.into(), rotation))
}

/// What must be true of every answer.
fn check(frame: &TrackedFrame) {
    let has_pose = frame.state == TrackState::Tracking;
    assert_eq!(frame.pose.is_some(), has_pose, "{frame:?}");
    assert_eq!(frame.covariance.is_some(), has_pose, "{frame:?}");
    assert_eq!(frame.source.is_some(), has_pose, "{frame:?}");
    assert_eq!(frame.reason.is_none(), has_pose, "{frame:?}");
    let t = frame.latency;
    let sum = t.recv_ms + t.decode_ms + t.track_ms + t.features_ms + t.match_ms + t.solve_ms;
    assert!((sum - t.total_ms).abs() < 1e-3, "{t:?}");
    assert!(frame.age_ms >= t.total_ms, "{frame:?}");
}

/// The map of the warehouse's scan, in the frame of the truth.
async fn warehouse_map(client: &Client, warehouse: &std::path::Path) -> Uuid {
    let scan = warehouse.join("scan");
    let camera = read_camera_json(&std::fs::read(scan.join("camera.json")).unwrap()).unwrap();
    let truth = read_poses(&scan.join("ground_truth.csv")).unwrap();
    let paths = truth.keys().map(|name| scan.join(name));
    let files = paths.map(|path| path.as_path().into()).collect();
    let set = upload(client, &Photos { files, camera: Some(camera) }).await;
    let priors = truth.iter().map(|(name, pose)| {
        let position = PositionPrior { position: pose.translation.vector.into(), sigma: 0.02 };
        (name.clone(), Prior { position: Some(position), ..Prior::default() })
    });
    client.put_priors(set, priors.collect()).await.unwrap();
    let request = CreateJob {
        imageset_ids: vec![set],
        stages: vec![StageGroup::Sfm],
        ..CreateJob::default()
    };
    let job = client.create_job(&request).await.unwrap();
    client.watch_job(job.id, |_| {}).await.unwrap();
    mapped(client, job.id).await.outputs.unwrap().map_id
}

fn at(values: &[f64], part: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[((sorted.len() as f64 * part) as usize).min(sorted.len() - 1)]
}

/// The 150 frames of the warehouse's flight at their pace, blurred and dark ones among them: clean
/// frames within 5 cm and 1 degree at the 95th percentile, no frame silently without a pose.
#[test]
fn the_warehouse_flight_is_followed_live() {
    if std::env::var_os("VOLERY_LONG").is_none() {
        eprintln!("SKIPPED: VOLERY_LONG is not set");
        return;
    }
    let Some(warehouse) = shared_data("warehouse_render") else { return };
    let flight = warehouse.join("flight");
    let read = |name: &str| std::fs::read(flight.join(name)).unwrap();
    let camera = read_camera_json(&read("camera.json")).unwrap();
    let truth = read_poses(&flight.join("ground_truth.csv")).unwrap();
    let told = read_telemetry_csv(&read("telemetry.csv"), &TelemetrySigmas::default()).unwrap();
    let flags = String::from_utf8(read("frames.csv")).unwrap();
    let is_clean = |name: &str| flags.lines().any(|l| l.starts_with(name) && l.ends_with(','));
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let answers = runtime.block_on(async {
        let folder = Folder::new("live-pose");
        let server = Server::start(&folder.join("data"));
        let client = server.client();
        let map = warehouse_map(&client, &warehouse).await;
        let mut stream = open(&client, map, &camera).await;
        let mut answers: BTreeMap<u64, Option<Box<TrackedFrame>>> = BTreeMap::new();
        let mut ticks = tokio::time::interval(STEP);
        let mut sent = 0;
        while answers.len() < told.len() {
            tokio::select! {
                _ = ticks.tick(), if sent < told.len() => {
                    let row = &told[sent].prior;
                    let telemetry = FrameTelemetry {
                        heading: row.attitude.map(|a| a.yaw),
                        heading_sigma: row.attitude.map(|a| a.sigma_yaw),
                        height: row.height.map(|h| h.height),
                        height_sigma: row.height.map(|h| h.sigma),
                        ..FrameTelemetry::default()
                    };
                    let frame = read(&told[sent].image);
                    stream.send_frame(&header(sent as u64, Some(telemetry)), &frame).await.unwrap();
                    sent += 1;
                }
                answer = stream.next() => match answer.unwrap() {
                    StreamAnswer::Tracked { seq, frame, .. } => {
                        answers.insert(seq, Some(frame));
                    }
                    StreamAnswer::Dropped { seq, reason } => {
                        assert_eq!(reason, "superseded");
                        answers.insert(seq, None);
                    }
                    other => panic!("{other:?}"),
                },
            }
        }
        answers
    });
    let (mut shifts, mut turns, mut totals, mut worked) = (vec![], vec![], vec![], vec![]);
    let (mut superseded, mut without) = (0, Vec::new());
    for (seq, answer) in &answers {
        let name = &told[*seq as usize].image;
        let Some(frame) = answer else {
            superseded += 1;
            continue;
        };
        check(frame);
        totals.push(frame.latency.total_ms);
        worked.push(frame.latency.total_ms - frame.latency.recv_ms);
        let Some(found) = pose(frame) else {
            without.push((name.as_str(), frame.state, frame.reason.clone().unwrap_or_default()));
            continue;
        };
        if is_clean(name) {
            let truth = &truth[name];
            shifts.push((found.translation.vector - truth.translation.vector).norm());
            turns.push(found.rotation.angle_to(&truth.rotation).to_degrees());
        }
    }
    let line = |what: &str, values: &[f64]| {
        let [p50, p95, most] = [0.5, 0.95, 1.0].map(|part| at(values, part));
        eprintln!("{what}: p50 {p50:.4}, p95 {p95:.4}, most {most:.4}");
    };
    line("clean frames, m", &shifts);
    line("clean frames, degrees", &turns);
    line("arrival to answer, ms", &totals);
    line("of that in the worker, ms", &worked);
    eprintln!("{superseded} superseded, without a pose: {without:?}");
    assert!(at(&shifts, 0.95) < 0.05 && at(&turns, 0.95) < 1.0);
    let clean_without = without.iter().filter(|(name, ..)| is_clean(name)).count();
    // The first two wait for a third, and three fixes bring it back after a loss.
    assert!(clean_without <= 6, "{without:?}");
}
