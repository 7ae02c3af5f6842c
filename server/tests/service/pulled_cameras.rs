//! Cameras that the service pulls, over real sockets.

use std::{
    sync::atomic::Ordering,
    time::{Duration, Instant},
};

use crate::{
    socket::{connect, next, say},
    support::{
        Client, Server,
        camera::{Answer, TestCamera},
        config,
        field::{self, Field, believes_to_be_at},
        photo,
    },
};
use serde_json::{Value, json};
use volery_server::Config;
use volery_simulator::{DroneOptions, Flavor};

const PATH: &str = "/v1/drones/7/camera";

/// On a machine that is busy with much else.
const PATIENCE: Duration = Duration::from_secs(40);

fn allow_loopback(config: &mut Config) {
    config.camera_hosts = vec!["127.0.0.0/8".parse().unwrap()];
}

/// The camera of a drone, once it is as wanted.
async fn camera_when(client: &Client, path: &str, is_wanted: impl Fn(&Value) -> bool) -> Value {
    let start = Instant::now();
    loop {
        let camera = client.get(path).await.expect(200).json();
        if is_wanted(&camera) {
            return camera;
        }
        assert!(start.elapsed() < PATIENCE, "{camera:#}");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

/// Until nobody looks at the camera any more.
async fn left_alone(camera: &TestCamera) {
    let start = Instant::now();
    while camera.num_open.load(Ordering::Relaxed) > 0 {
        assert!(start.elapsed() < PATIENCE, "the camera is still looked at");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}

async fn put(client: &Client, path: &str, camera: Value) -> Value {
    client.json("PUT", path, &[], camera).await.expect(200).json()
}

fn frames(camera: &Value) -> u64 {
    camera["frames"].as_u64().unwrap()
}

/// Pictures become poses and are shown; a camera that is away is found again, also when its clock
/// has begun anew; with `DELETE` it is left alone.
#[tokio::test]
async fn a_pulled_camera_tells_where_its_drone_is() {
    let server = Server::start_with(allow_loopback).await;
    let client = &server.client;
    let map = client.map().await;
    let mut listener = connect(&server).await;
    say(&mut listener, json!({"type": "subscribe", "topic": "pose:7"})).await;
    assert_eq!(next(&mut listener).await["type"], "subscribed");
    client.get(PATH).await.expect(404);

    let camera = TestCamera::start(Answer::Pictures).await;
    let put_at = Instant::now();
    let made = put(client, PATH, json!({"url": camera.url(), "map_id": map})).await;
    assert_eq!((&made["state"], &made["map_version"]), (&json!("connecting"), &json!(1)));
    assert_eq!(made["settings"]["feed"], false);
    for _ in 0..3 {
        let pose = next(&mut listener).await;
        assert_eq!((&pose["type"], &pose["drone_id"]), (&json!("pose"), &json!("7")));
        assert_eq!((&pose["result"]["state"], &pose["map_id"]), (&json!("tracking"), &json!(map)));
    }
    let shown = client.get("/v1/drones/7/frame").await.expect(200);
    assert!(shown.body.starts_with(&photo("picture ")), "as it came");
    let streaming = camera_when(client, PATH, |camera| frames(camera) > 40).await;
    let most = put_at.elapsed().as_secs_f64() / 0.05 + 1.0;
    assert!(frames(&streaming) as f64 <= most, "{streaming:#}");
    // At most one every 50 ms; a busy machine sends fewer.
    let rate = streaming["rate_hz"].as_f64().unwrap();
    assert!(rate > 2.0 && rate < 25.0, "{streaming:#}");
    assert_eq!(
        (&streaming["state"], &streaming["last_error"]),
        (&json!("streaming"), &Value::Null)
    );

    let addr = camera.addr;
    drop(camera);
    camera_when(client, PATH, |camera| camera["state"] == "failed").await;
    let camera = TestCamera::start_at(addr, Answer::BarePictures).await;
    let before = frames(&client.get(PATH).await.json());
    let again = camera_when(client, PATH, |camera| frames(camera) > before + 5).await;
    assert_eq!(again["state"], "streaming");
    assert!(again["last_error"]["code"].as_str().unwrap().starts_with("camera_"), "{again:#}");
    let metrics = client.get("/metrics").await.expect(200).body;
    let metrics = String::from_utf8(metrics).unwrap();
    let count = |name: &str| {
        let line = metrics.lines().find_map(|line| line.strip_prefix(name)).unwrap();
        line.trim().parse::<u64>().unwrap()
    };
    assert!(count("volery_camera_frames_total ") >= frames(&again));
    assert!(count("volery_camera_failures_total ") >= 1);

    client.delete(PATH).await.expect(204);
    left_alone(&camera).await;
    let num_asked = camera.num_asked.load(Ordering::Relaxed);
    // Longer than the wait before another try.
    tokio::time::sleep(Duration::from_millis(700)).await;
    assert_eq!(camera.num_asked.load(Ordering::Relaxed), num_asked, "it is left alone");
    client.get(PATH).await.expect(404);
    client.delete(PATH).await.expect(404);
}

/// A new start of the service goes on with the cameras, if they may still be pulled. A second camera
/// takes the place of the first, and goes with the drone's settings.
#[tokio::test]
async fn cameras_outlive_the_service() {
    let server = Server::start_with(|config| {
        allow_loopback(config);
        field::hear_drones(config);
    })
    .await;
    let map = server.client.map().await;
    let first = TestCamera::start(Answer::Pictures).await;
    let camera = TestCamera::start(Answer::Pictures).await;
    for camera in [&first, &camera] {
        put(&server.client, PATH, json!({"url": camera.url(), "map_id": map})).await;
        camera_when(&server.client, PATH, |camera| frames(camera) > 2).await;
    }
    left_alone(&first).await;
    let Server { running, client, folder } = server;
    running.stop().await;

    let data = folder.0.join("data");
    let strict = volery_server::start(config(&data)).await.unwrap();
    let client = Client { addr: strict.addr, ..client };
    let refused = client.get(PATH).await.expect(200).json();
    assert_eq!(refused["last_error"]["code"], "camera_host_refused");
    assert_eq!((&refused["state"], &refused["map_version"]), (&json!("failed"), &Value::Null));
    strict.stop().await;

    let mut config = config(&data);
    allow_loopback(&mut config);
    field::hear_drones(&mut config);
    let running = volery_server::start(config).await.unwrap();
    let client = Client { addr: running.addr, ..client };
    let again = camera_when(&client, PATH, |camera| frames(camera) > 2).await;
    assert_eq!(again["settings"]["url"], camera.url());
    client.json("PUT", "/v1/drones/7", &[], json!({"name": "seven"})).await.expect(200);
    client.delete("/v1/drones/7").await.expect(204);
    client.get(PATH).await.expect(404);
    running.stop().await;
}

/// What is refused is refused at once, whoever asks.
#[tokio::test]
async fn cameras_are_pulled_from_allowed_hosts_by_pilots() {
    let server = Server::start_with(|config| {
        config.camera_hosts = vec!["127.0.0.1:8081".parse().unwrap(), "cam.lan".parse().unwrap()];
    })
    .await;
    let client = &server.client;
    let map = client.map().await;
    for (url, code) in [
        ("http://127.0.0.1:8082/", "camera_host_refused"),
        ("http://127.0.0.2:8081/", "camera_host_refused"),
        ("http://[::1]:8081/", "camera_host_refused"),
        ("https://cam.lan/", "bad_camera_url"),
        ("http://user:word@cam.lan/", "bad_camera_url"),
        ("file:///etc/passwd", "bad_camera_url"),
        ("cam.lan", "bad_camera_url"),
    ] {
        let body = json!({"url": url, "map_id": map});
        let answer = client.json("PUT", PATH, &[], body).await.expect(422);
        assert_eq!(answer.code(), code, "{url}");
    }
    let good = json!({"url": "http://cam.lan/", "map_id": map});
    for (path, change, status, code) in [
        ("/v1/drones/0/camera", json!({}), 422, "bad_system_id"),
        ("/v1/drones/255/camera", json!({}), 422, "bad_system_id"),
        (PATH, json!({"fed": true}), 422, "unknown_field"),
        (PATH, json!({"feed": true}), 409, "no_mavlink"),
        (PATH, json!({"version": 9}), 404, "not_found"),
        (
            PATH,
            json!({"camera": {"model": "PINHOLE", "width": 0, "height": 480,
            "params": [1, 1, 1, 1]}}),
            422,
            "bad_camera",
        ),
    ] {
        let mut body = good.clone();
        body.as_object_mut().unwrap().extend(change.as_object().unwrap().clone());
        let answer = client.json("PUT", path, &[], body).await.expect(status);
        assert_eq!(answer.code(), code);
    }
    for role in ["viewer", "mapper"] {
        let token = json!({"name": role, "role": role});
        let made = client.post("/v1/tokens", token).await.expect(201).json();
        let other = client.with_token(made["secret"].as_str());
        other.json("PUT", PATH, &[], good.clone()).await.expect(403);
        other.get(PATH).await.expect(403);
        other.delete(PATH).await.expect(403);
    }
    client.get(PATH).await.expect(404);
}

/// A camera that misbehaves is left with a name for what it does, and tried again later.
#[tokio::test]
async fn what_is_wrong_with_a_camera_has_a_name() {
    let server = Server::start_with(|config| {
        allow_loopback(config);
        config.limits.image_bytes = 100_000;
    })
    .await;
    let client = &server.client;
    let map = client.map().await;
    let other = TestCamera::start(Answer::Pictures).await;
    let head = "HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=cut\r\n\r\n";
    let answer = |text: String| Answer::Bytes(text.into_bytes());
    let cameras = [
        (
            answer(format!("HTTP/1.1 302 Found\r\nLocation: {}\r\n\r\n", other.url())),
            "camera_redirect",
        ),
        (answer("HTTP/1.1 401 Unauthorized\r\n\r\n".to_owned()), "camera_status"),
        (answer("HTTP/1.0 404 Not Found\r\n\r\n".to_owned()), "camera_status"),
        (
            answer("HTTP/1.1 200 OK\r\nContent-Type: image/jpeg\r\n\r\n".to_owned()),
            "camera_not_mjpeg",
        ),
        (answer("HTTP/1.1 200 OK\r\n\r\n".to_owned()), "camera_not_mjpeg"),
        (answer("what?".to_owned()), "camera_unreachable"),
        (answer(String::new()), "camera_unreachable"),
        (answer(format!("{head}--cut\r\n\r\n{}", "x".repeat(120_000))), "camera_frame_too_large"),
        (
            answer(format!("{head}--cut\r\nContent-Length: 2\r\n\r\nabcdef\r\n")),
            "camera_stream_broken",
        ),
        (answer(format!("{head}{}", "no lines ".repeat(2000))), "camera_stream_broken"),
        (answer(format!("{head}--cut\r\nContent-Le")), "camera_silent"),
        (Answer::BytesAndEnd(format!("{head}--cut--\r\n").into_bytes()), "camera_ended"),
        (
            answer(format!(
                "{head}--cut\r\nContent-Length: 1\r\nX-Timestamp: 5\r\n\r\na\r\n\
                 --cut\r\nContent-Length: 1\r\nX-Timestamp: 4\r\n\r\na\r\n"
            )),
            "camera_clock",
        ),
        (Answer::Drip, "camera_too_slow"),
    ];
    let mut running = Vec::new();
    for ((answer, code), id) in cameras.into_iter().zip(1..) {
        let camera = TestCamera::start(answer).await;
        let path = format!("/v1/drones/{id}/camera");
        put(client, &path, json!({"url": camera.url(), "map_id": map})).await;
        running.push((path, camera, code));
    }
    for (path, _, code) in &running {
        let failed = camera_when(client, path, |camera| {
            let error = &camera["last_error"]["code"];
            error.as_str().is_some_and(|code| code.starts_with("camera_"))
        });
        let failed = failed.await;
        assert_eq!(failed["last_error"]["code"], *code, "{failed:#}");
    }
    assert_eq!(other.num_asked.load(Ordering::Relaxed), 0, "nobody follows");
    // Refused for good reasons, and asked once in ten seconds only.
    let (_, redirecting, _) = &running[0];
    assert!(redirecting.num_asked.load(Ordering::Relaxed) <= 4);
    let gone = running[0].1.addr;
    let path = running[0].0.clone();
    drop(running);
    put(client, &path, json!({"url": format!("http://{gone}/"), "map_id": map})).await;
    let failed = camera_when(client, &path, |camera| camera["state"] == "failed").await;
    assert_eq!(failed["last_error"]["code"], "camera_unreachable");
}

/// A simulated drone that knows nothing but the poses of its pulled camera says that it is where the
/// camera is.
#[tokio::test]
async fn a_pulled_camera_feeds_its_drone() {
    let server = Server::start_with(|config| {
        allow_loopback(config);
        field::hear_drones(config);
    })
    .await;
    let client = &server.client;
    let map = client.map().await;
    let camera = TestCamera::start(Answer::Pictures).await;
    let settings = json!({"url": camera.url(), "map_id": map, "feed": true});
    let refused = client.json("PUT", PATH, &[], settings.clone()).await.expect(409);
    assert_eq!(refused.code(), "map_not_metric");
    let align = json!({"known_distance": {"image_a": "a.jpg", "image_b": "b.jpg", "meters": 3.0}});
    client.post(&format!("/v1/maps/{map}/align"), align).await.expect(201);
    put(client, PATH, settings).await;
    let drone = DroneOptions::new(7, Flavor::Px4, [0.0; 3].into());
    let field = Field::open_untold(&server, vec![drone]);
    field.until("/v1/drones/7", |drone| believes_to_be_at(drone, [1.0, 2.0, 0.5])).await;
    assert_eq!(field.close().await.contacts, 0);
}
