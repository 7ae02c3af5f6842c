//! Group flights over HTTP: plans, refusals, fences; positions by beacons.

use std::net::SocketAddr;

use crate::support::Server;
use serde_json::{Value, json};
use volery_server::MavlinkSettings;

async fn server() -> Server {
    Server::start_with(|config| {
        config.mavlink = Some(MavlinkSettings::new(SocketAddr::from(([127, 0, 0, 1], 0))));
    })
    .await
}

/// A map in meters.
async fn metric_map(server: &Server) -> String {
    let map = server.client.map().await;
    let align = json!({"known_distance": {"image_a": "a.jpg", "image_b": "b.jpg", "meters": 3.0}});
    server.client.post(&format!("/v1/maps/{map}/align"), align).await.expect(201);
    map
}

/// A hall of 10 m by 10 m, 4 m high, with a pillar in a corner.
fn fence(map: &str) -> Value {
    json!({
        "map_id": map,
        "area": {"outline": [[0, 0], [10, 0], [10, 10], [0, 10]], "floor": 0, "ceiling": 4},
        "keep_out": [{"outline": [[8, 8], [9, 8], [9, 9]], "floor": 0, "ceiling": 4}],
        "margin_m": 0.3,
    })
}

/// Two drones, each from its start to its goal.
fn two(map: &str, starts: [[f64; 3]; 2], goals: [[f64; 3]; 2]) -> Value {
    let drone = |k: usize| json!({"id": k + 1, "start": {"position": starts[k]}, "goals": [{"position": goals[k]}]});
    json!({"map_id": map, "drones": [drone(0), drone(1)]})
}

const WEST: [[f64; 3]; 2] = [[2.0, 3.0, 1.5], [2.0, 7.0, 1.5]];
const EAST_CROSSED: [[f64; 3]; 2] = [[8.0, 7.0, 1.5], [7.0, 3.0, 1.5]];

#[tokio::test]
async fn a_crossing_flight_is_planned_and_waits_for_its_drones() {
    let server = server().await;
    let client = &server.client;
    let map = metric_map(&server).await;
    client.json("PUT", "/v1/geofences", &[], fence(&map)).await.expect(200);
    let made = client.post("/v1/flights", two(&map, WEST, EAST_CROSSED)).await.expect(201);
    let path = made.header("location").unwrap().to_owned();
    let flight = made.json();
    assert_eq!(flight["state"], "ready");
    assert!(flight["closest_m"].as_f64().unwrap() >= 1.0);
    let legs = flight["drones"][0]["legs"].as_array().unwrap();
    assert_eq!(legs.last().unwrap()["to"], json!([8.0, 7.0, 1.5]));
    assert_eq!(client.get(&path).await.expect(200).json(), flight);
    let list = client.get("/v1/flights").await.expect(200).json();
    assert_eq!(list.as_array().unwrap().len(), 1);

    let start = client.post(&format!("{path}/start"), json!(null)).await.expect(409);
    assert_eq!(start.code(), "not_at_start", "nobody was heard");
    for wish in ["pause", "resume"] {
        let answer = client.post(&format!("{path}/{wish}"), json!(null)).await.expect(409);
        assert_eq!(answer.code(), "flight_state");
    }
    let aborted = client.post(&format!("{path}/abort"), json!(null)).await.expect(202).json();
    assert_eq!(aborted["state"], "aborted");
    client.get(&format!("/v1/flights/{map}")).await.expect(404);
}

/// A refusal names the rule, the drones and the time.
#[tokio::test]
async fn bad_plans_are_refused_with_the_reason() {
    let server = server().await;
    let client = &server.client;
    let map = client.map().await;
    let crossing = two(&map, WEST, EAST_CROSSED);
    client.json("PUT", "/v1/geofences", &[], fence(&map)).await.expect(200);
    let answer = client.post("/v1/flights", crossing.clone()).await.expect(409);
    assert_eq!(answer.code(), "map_not_metric");

    let server = self::server().await;
    let client = &server.client;
    let map = metric_map(&server).await;
    let crossing = two(&map, WEST, EAST_CROSSED);
    client.json("PUT", "/v1/geofences", &[], fence(&map)).await.expect(200);
    let near = two(&map, WEST, [[6.0, 5.0, 1.5], [6.0, 5.6, 1.5]]);
    let answer = client.post("/v1/flights", near).await.expect(422);
    assert_eq!(answer.code(), "too_close");
    let detail = answer.json()["detail"].as_str().unwrap().to_owned();
    assert!(detail.contains("vehicles 1 and 2") && detail.contains(" s, "), "{detail}");
    for (goals, code) in [
        ([[8.0, 7.0, 3.9], [7.0, 3.0, 1.5]], "out_of_fence"),
        ([[8.5, 8.2, 1.5], [7.0, 3.0, 1.5]], "out_of_fence"),
        ([[80.0, 7.0, 1.5], [7.0, 3.0, 1.5]], "out_of_fence"),
    ] {
        let answer = client.post("/v1/flights", two(&map, WEST, goals)).await.expect(422);
        assert_eq!(answer.code(), code);
    }
    for (key, value, code) in [
        ("separation_m", json!(0.0), "bad_rules"),
        ("margin_m", json!(-1.0), "bad_rules"),
        ("speed", json!(0.0), "bad_rules"),
        ("color", json!("red"), "unknown_field"),
    ] {
        let mut request = crossing.clone();
        request[key] = value;
        assert_eq!(client.post("/v1/flights", request).await.expect(422).code(), code, "{key}");
    }
    let mut twice = crossing.clone();
    twice["drones"][1]["id"] = json!(1);
    assert_eq!(client.post("/v1/flights", twice).await.expect(422).code(), "drone_twice");
    let mut nowhere = crossing.clone();
    nowhere["drones"][0].as_object_mut().unwrap().remove("start");
    assert_eq!(client.post("/v1/flights", nowhere).await.expect(409).code(), "place_unknown");
    assert_eq!(client.get("/v1/flights").await.expect(200).json(), json!([]));
}

#[tokio::test]
async fn only_pilots_plan_and_fence() {
    let server = server().await;
    let admin = &server.client;
    let map = metric_map(&server).await;
    for (role, allowed) in [("viewer", false), ("mapper", false), ("pilot", true)] {
        let token = json!({"name": role, "role": role});
        let made = admin.post("/v1/tokens", token).await.expect(201).json();
        let client = admin.with_token(made["secret"].as_str());
        let (set, plan) = if allowed { (200, 201) } else { (403, 403) };
        client.json("PUT", "/v1/geofences", &[], fence(&map)).await.expect(set);
        client.post("/v1/flights", two(&map, WEST, EAST_CROSSED)).await.expect(plan);
        client.get("/v1/flights").await.expect(200);
    }
}

#[tokio::test]
async fn fences_are_checked_and_kept() {
    let server = server().await;
    let client = &server.client;
    let map = metric_map(&server).await;
    let put = |fence: Value| client.json("PUT", "/v1/geofences", &[], fence);
    let mut crossed = fence(&map);
    crossed["area"]["outline"] = json!([[0, 0], [2, 2], [2, 0], [0, 1]]);
    assert_eq!(put(crossed).await.expect(422).code(), "bad_geofence");
    let mut flat = fence(&map);
    flat["area"]["ceiling"] = json!(0);
    assert_eq!(put(flat).await.expect(422).code(), "bad_geofence");
    let stranger = fence("00000000-0000-7000-8000-000000000000");
    put(stranger).await.expect(404);
    assert_eq!(client.get("/v1/geofences").await.expect(200).json(), json!([]));
    put(fence(&map)).await.expect(200);
    let mut wider = fence(&map);
    wider["margin_m"] = json!(0.5);
    put(wider.clone()).await.expect(200);
    let kept = client.get("/v1/geofences").await.expect(200).json();
    assert_eq!(kept.as_array().unwrap().len(), 1, "one fence per map");
    assert_eq!(kept[0]["margin_m"], 0.5);
    client.delete(&format!("/v1/geofences/{map}")).await.expect(204);
    assert_eq!(client.get("/v1/geofences").await.expect(200).json(), json!([]));
    client.delete(&format!("/v1/geofences/{map}")).await.expect(404);
}

#[tokio::test]
async fn beacons_give_a_position() {
    let server = Server::start().await;
    let client = &server.client;
    let place: [f64; 3] = [2.0, 1.0, 1.2];
    let beacons: [[f64; 3]; 3] = [[0.0, 0.0, 2.0], [6.0, 0.0, 2.0], [3.0, 5.0, 2.0]];
    let range = |b: &[f64; 3]| (0..3).map(|k| (b[k] - place[k]).powi(2)).sum::<f64>().sqrt();
    let readings: Vec<_> =
        beacons.iter().map(|b| json!({"beacon": b, "range_m": range(b)})).collect();
    let request = json!({"readings": readings, "height_tof_m": 1.2});
    let fix = client.post("/v1/beacons/estimate", request).await.expect(200).json();
    for k in 0..3 {
        assert!((fix["position"][k].as_f64().unwrap() - place[k]).abs() < 1e-4, "{fix}");
        assert!((0.001..0.2).contains(&fix["sigma"][k].as_f64().unwrap()), "{fix}");
    }
    let strengths: Vec<_> = beacons
        .iter()
        .map(|b| json!({"beacon": b, "rssi_dbm": -59.0 - 22.0 * range(b).log10()}))
        .collect();
    let request = json!({"readings": strengths, "height": 1.2});
    let fix = client.post("/v1/beacons/estimate", request).await.expect(200).json();
    assert_eq!(fix["position"].as_array().unwrap().len(), 2);
    assert!((fix["position"][0].as_f64().unwrap() - 2.0).abs() < 1e-4, "{fix}");
    for (readings, code) in [
        (json!(readings[..2]), "too_few_ranges"),
        (json!([readings[0], readings[0], readings[0]]), "beacons_collinear"),
        (json!([readings[0], readings[1], {"beacon": [3, 5, 2]}]), "bad_reading"),
    ] {
        let answer = client.post("/v1/beacons/estimate", json!({"readings": readings})).await;
        assert_eq!(answer.expect(422).code(), code);
    }
}
