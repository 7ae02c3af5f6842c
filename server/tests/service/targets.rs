//! Targets of single drones: legs, checks, flights; simulated drones fly them.

use std::f64::consts::FRAC_PI_2;

use crate::support::{Client, field, field::Field, photo};
use serde_json::{Value, json};
use volery_simulator::{DroneOptions, Flavor};

/// A map in meters, fenced from -2 m to 20 m, that knows its free space or not.
async fn map(client: &Client, free_space: bool) -> String {
    let map = client.map().await;
    let meters = if free_space { 7.0 } else { 3.0 };
    let align =
        json!({"known_distance": {"image_a": "a.jpg", "image_b": "b.jpg", "meters": meters}});
    client.post(&format!("/v1/maps/{map}/align"), align).await.expect(201);
    let fence = json!({
        "map_id": map,
        "area": {"outline": [[-2, -8], [20, -8], [20, 20], [-2, 20]], "floor": 0, "ceiling": 5},
        "margin_m": 0.3,
    });
    client.json("PUT", "/v1/geofences", &[], fence).await.expect(200);
    map
}

fn legs<'a>(target: &'a Value, kind: &str) -> Vec<&'a Value> {
    target["legs"].as_array().unwrap().iter().filter(|leg| leg["kind"] == kind).collect()
}

fn state<'a>(target: &'a Value, rule: &str) -> &'a str {
    let checks = target["checks"].as_array().unwrap();
    checks.iter().find(|check| check["rule"] == rule).unwrap()["state"].as_str().unwrap()
}

/// Length of the way over the ends of all legs of a kind.
fn length(target: &Value, kind: &str) -> f64 {
    let place = |of: &Value| -> [f64; 3] { serde_json::from_value(of.clone()).unwrap() };
    let mut here = place(&target["start"]["position"]);
    let mut sum = 0.0;
    for leg in target["legs"].as_array().unwrap() {
        let to = place(&leg["to"]);
        let way: f64 = (0..3).map(|k| (to[k] - here[k]).powi(2)).sum::<f64>().sqrt();
        sum += if leg["kind"] == kind { way } else { 0.0 };
        here = to;
    }
    sum
}

/// The flight of the paper, a meter higher: a turn by 93.12 deg to the left, 3.734 m level over
/// views on the way, a frame, 1.150 m down, and a frame at the goal that says where the drone is.
#[tokio::test]
async fn the_flight_of_the_paper() {
    let server = field::server().await;
    let client = &server.client;
    let start = DroneOptions {
        yaw: 90.8_f64.to_radians(),
        ..DroneOptions::new(1, Flavor::ArduPilot, [6.425, 0.66, 0.0].into())
    };
    let field = Field::open(&server, vec![start]);
    field.take_off(&[1], 2.149).await;
    let map = map(client, false).await;
    let yaw = 187_f64.to_radians();
    let above = json!({"map_id": map, "position": [2.7, 0.405, 2.026], "yaw": yaw, "views": true});
    let mut dry = above.clone();
    dry["dry_run"] = json!(true);
    let plan = client.post("/v1/drones/1/target", dry).await.expect(200).json();
    assert_eq!(plan["flight_id"], Value::Null);
    assert_eq!(client.get("/v1/flights").await.expect(200).json(), json!([]));
    // It hovers within some centimeters and degrees of the paper's start.
    let turn = plan["turn"].as_f64().unwrap().to_degrees();
    assert!((turn - 93.12).abs() < 4.0, "{turn}");
    assert!((length(&plan, "horizontal") - 3.734).abs() < 0.2, "{plan:#}");
    assert!(legs(&plan, "view").len() >= 3, "views on the way and at its end: {plan:#}");
    for rule in ["map_metric", "geofence", "separation", "limits", "drone"] {
        assert_eq!(state(&plan, rule), "passed", "{plan:#}");
    }
    assert_eq!(state(&plan, "free_space"), "unknown");

    let under_way = client.post("/v1/drones/1/target", above).await.expect(202);
    let path = under_way.header("location").unwrap().to_owned();
    let flight = field.until(&path, |flight| flight["state"] == "finished").await;
    let kinds: Vec<&str> = flight["events"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|event| event["kind"] == "leg")
        .map(|event| event["value"].as_str().unwrap())
        .collect();
    assert_eq!(kinds[..3], ["turn", "horizontal", "view"], "{kinds:?}");
    let there = field.truth(1).position;
    assert!((there[0] - 2.7).hypot(there[1] - 0.405) < 0.25, "{there:?}");

    // Between the legs and at the goal a frame is sent, and its place by features is noted.
    let frames = format!("/v1/drones/1/frames?map_id={map}&age_ms=1");
    let kind = [("Content-Type", "image/jpeg")];
    let answer = client.send("POST", &frames, &kind, &photo("a frame")).await.expect(200).json();
    assert_eq!(
        (&answer["answer"]["method"], &answer["answer"]["status"]),
        (&json!("pnp"), &json!("ok"))
    );
    // The worker plays a place elsewhere: it is not passed on.
    assert_eq!(answer["place"]["sent"], false, "{answer}");
    assert!(answer["place"]["correction_m"].as_f64().unwrap() > 1.0);
    let goal_distance: f64 = [2.7, 0.405, 2.026]
        .iter()
        .zip(answer["place"]["position"].as_array().unwrap())
        .map(|(goal, place)| (goal - place.as_f64().unwrap()).powi(2))
        .sum();
    let told = answer["place"]["goal_distance_m"].as_f64().unwrap();
    assert!((told - goal_distance.sqrt()).abs() < 1e-6, "{told} {goal_distance}");
    assert_eq!(answer["job_id"], Value::Null, "nobody asked for it");
    let flight = client.get(&path).await.expect(200).json();
    assert_eq!(flight["events"].as_array().unwrap().last().unwrap()["kind"], "frame");

    let below = json!({"map_id": map, "position": [2.7, 0.405, 0.876], "yaw": yaw});
    let down = client.post("/v1/drones/1/target", below).await.expect(202);
    assert!((length(&down.json(), "vertical") - 1.150).abs() < 0.15, "{:#}", down.json());
    let path = down.header("location").unwrap();
    field.until(path, |flight| flight["state"] == "finished").await;
    let there = field.truth(1).position;
    assert!((there[2] - 0.876).abs() < 0.25, "{there:?}");

    // On wish it joins the map, and whoever looks sees it.
    let frames = format!("{frames}&extend=true");
    let answer = client.send("POST", &frames, &kind, &photo("another")).await.expect(200).json();
    let job = client.finished(answer["job_id"].as_str().unwrap()).await;
    assert_eq!((&job["kind"], &job["outputs"]["map_id"]), (&json!("extend_map"), &json!(map)));
    let seen = client.get("/v1/drones/1/frame").await.expect(200);
    assert_eq!((&seen.body, seen.header("content-type")), (&photo("another"), Some("image/jpeg")));
    assert!(seen.header("x-frame-age-ms").unwrap().parse::<u64>().unwrap() < 60_000);
    let tag = seen.header("etag").unwrap();
    let again = client.send("GET", "/v1/drones/1/frame", &[("If-None-Match", tag)], b"").await;
    assert!(again.expect(304).header("x-frame-age-ms").is_some());
    client.get("/v1/drones/2/frame").await.expect(404);
    assert_eq!(field.close().await.contacts, 0);
}

/// A dry run names what is wrong; what is wrong is not flown.
#[tokio::test]
async fn targets_are_checked() {
    let server = field::server().await;
    let client = &server.client;
    let drone = |id: u8, x, y| DroneOptions::new(id, Flavor::Px4, [x, y, 0.0].into());
    let field =
        Field::open(&server, vec![drone(1, 0.0, 0.0), drone(2, 2.0, 4.0), drone(3, 0.0, 8.0)]);
    field.take_off(&[1, 2], 1.5).await;
    let map = map(client, true).await;
    let path = "/v1/drones/1/target";
    let target = |position: [f64; 3]| json!({"map_id": map, "position": position, "dry_run": true});
    for (position, rule, code) in [
        ([8.0, 0.0, 1.5], "free_space", "not_free"),
        ([0.0, 0.0, 4.9], "geofence", "out_of_fence"),
        ([2.0, 4.0, 1.5], "separation", "too_close"),
    ] {
        let mut request = target(position);
        let plan = client.post(path, request.clone()).await.expect(200).json();
        assert_eq!(state(&plan, rule), "failed", "{plan:#}");
        request["dry_run"] = json!(false);
        assert_eq!(client.post(path, request).await.expect(422).code(), code);
    }
    let mut beyond = target([13.0, 3.0, 1.5]);
    let plan = client.post(path, beyond.clone()).await.expect(200).json();
    assert_eq!(state(&plan, "free_space"), "failed");
    beyond["allow_unseen"] = json!(true);
    let plan = client.post(path, beyond).await.expect(200).json();
    assert_eq!(state(&plan, "free_space"), "passed");
    let around = client.post(path, target([5.25, -3.0, 1.5])).await.expect(200).json();
    assert_eq!(state(&around, "free_space"), "passed", "{around:#}");
    assert!(around["closest_m"].as_f64().unwrap() > 1.0);

    let grounded = client.post("/v1/drones/3/target", target([0.0, 8.0, 1.5])).await.expect(200);
    assert_eq!(state(&grounded.json(), "drone"), "failed");
    let mut request = target([0.0, 8.0, 1.5]);
    request["dry_run"] = json!(false);
    client.post("/v1/drones/3/target", request).await.expect(422);
    client.post("/v1/drones/9/target", target([0.0, 0.0, 1.5])).await.expect(404);
    let flat = client.map().await;
    let mut elsewhere = target([1.0, 0.0, 1.5]);
    elsewhere["map_id"] = json!(flat);
    assert_eq!(client.post(path, elsewhere).await.expect(409).code(), "no_geofence");

    // A flight of a group asks the same.
    let group = json!({"map_id": map, "style": "straight", "drones": [
        {"id": 1, "goals": [{"position": [8.0, 0.25, 1.5]}]},
        {"id": 2, "goals": [{"position": [2.0, 6.0, 1.5]}]}]});
    assert_eq!(client.post("/v1/flights", group).await.expect(422).code(), "not_free");
    let alone = json!({"map_id": map, "style": "straight", "drones": [
        {"id": 1, "goals": [{"position": [2.0, 4.0, 1.5]}]}]});
    assert_eq!(client.post("/v1/flights", alone).await.expect(422).code(), "too_close");
    assert_eq!(field.close().await.contacts, 0);
}

/// The newest wish counts: another target, a command, all-stop.
#[tokio::test]
async fn a_newer_wish_ends_the_flight_to_a_target() {
    let server = field::server().await;
    let client = &server.client;
    let drone = |id: u8, y| DroneOptions::new(id, Flavor::ArduPilot, [0.0, y, 0.0].into());
    let field = Field::open(&server, vec![drone(1, 0.0), drone(2, 6.0)]);
    field.take_off(&[1, 2], 1.5).await;
    let map = map(client, false).await;
    let fly = async |drone: u8, position: [f64; 3]| {
        let request = json!({"map_id": map, "position": position, "yaw": FRAC_PI_2});
        let made = client.post(&format!("/v1/drones/{drone}/target"), request).await.expect(202);
        made.header("location").unwrap().to_owned()
    };
    let running =
        |flight: &Value| flight["state"] == "running" && flight["clock_s"].as_f64() > Some(3.0);
    let stopped = |flight: &Value| flight["state"] == "aborted";
    let first = fly(1, [15.0, 0.0, 1.5]).await;
    field.until(&first, running).await;
    let second = fly(1, [15.0, -5.0, 1.5]).await;
    field.until(&first, stopped).await;
    field.until(&second, running).await;
    client.post("/v1/drones/1/commands", json!({"type": "hold"})).await.expect(202);
    field.until(&second, stopped).await;

    let (third, fourth) = (fly(1, [15.0, 0.0, 1.5]).await, fly(2, [15.0, 6.0, 1.5]).await);
    field.until(&third, running).await;
    field.until(&fourth, running).await;
    let stop = client.post("/v1/all-stop", json!(null)).await.expect(200).json();
    assert_eq!(stop["commands"].as_array().unwrap().len(), 2);
    for flight in [third, fourth] {
        field.until(&flight, stopped).await;
    }
    for drone in [1, 2] {
        let stands = |state: &Value| {
            let velocity = &state["estimate"]["velocity"];
            (0..3).all(|axis| velocity[axis].as_f64().unwrap().abs() < 0.15)
        };
        field.until(&format!("/v1/drones/{drone}/state"), stands).await;
        assert!(field.truth(drone).position[0] < 14.0, "it would have gone on");
    }

    // In a group, drones are commanded by the flight; each can be taken down.
    let group = json!({"map_id": map, "drones": [
        {"id": 1, "goals": [{"position": [15.0, 0.0, 1.5]}]},
        {"id": 2, "goals": [{"position": [15.0, 6.0, 1.5]}]}]});
    let made = client.post("/v1/flights", group).await.expect(201);
    let path = made.header("location").unwrap().to_owned();
    client.post(&format!("{path}/start"), json!(null)).await.expect(202);
    field.until(&path, |flight| flight["state"] == "running").await;
    let hold = client.post("/v1/drones/1/commands", json!({"type": "hold"})).await.expect(409);
    assert_eq!(hold.code(), "drone_busy");
    client.post("/v1/drones/1/commands", json!({"type": "land"})).await.expect(202);
    field.until("/v1/drones/1/state", |state| state["armed"] == false).await;
    assert_eq!(field.close().await.contacts, 0);
}
