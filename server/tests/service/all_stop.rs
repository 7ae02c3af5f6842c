//! All stop while a group flies.

use crate::support::{field, field::Field};
use serde_json::json;
use volery_simulator::{DroneOptions, Flavor};

/// Flights do not steer on those who were stopped.
#[tokio::test]
async fn a_group_under_way_stops_and_stays() {
    let server = field::server().await;
    let client = &server.client;
    let map = client.map().await;
    let align = json!({"known_distance": {"image_a": "a.jpg", "image_b": "b.jpg", "meters": 3.0}});
    client.post(&format!("/v1/maps/{map}/align"), align).await.expect(201);
    let outline = json!([[-5, -5], [30, -5], [30, 10], [-5, 10]]);
    let area = json!({"outline": outline, "floor": 0, "ceiling": 4});
    let fence = json!({"map_id": map, "area": area, "margin_m": 0.3});
    client.json("PUT", "/v1/geofences", &[], fence).await.expect(200);

    let drone = |id: u8, flavor| {
        DroneOptions::new(id, flavor, [0.0, 3.0 * f64::from(id) - 3.0, 0.0].into())
    };
    let field = Field::open(&server, vec![drone(1, Flavor::ArduPilot), drone(2, Flavor::Px4)]);
    for id in [1, 2] {
        field.until(&format!("/v1/drones/{id}/state"), |state| state["feed"] == "ready").await;
    }
    let at = |x: f64, y: f64| json!({"position": [x, y, 1.5]});
    let far = |id: u8, y: f64| json!({"id": id, "start": at(0.0, y), "goals": [at(25.0, y)]});
    let request = json!({"map_id": map, "drones": [far(1, 0.0), far(2, 3.0)]});
    let made = client.post("/v1/flights", request).await.expect(201);
    let path = made.header("location").unwrap().to_owned();
    client.post(&format!("{path}/start"), json!(null)).await.expect(202);
    let speed = |state: &serde_json::Value| state["estimate"]["velocity"][0].as_f64().unwrap();
    for id in [1, 2] {
        field.until(&format!("/v1/drones/{id}/state"), |state| speed(state) > 0.3).await;
    }

    let stopped = client.post("/v1/all-stop", json!(null)).await.expect(200).json();
    assert_eq!(stopped["commands"].as_array().unwrap().len(), 2);
    assert_eq!(client.get(&path).await.expect(200).json()["state"], "aborted");
    for command in stopped["commands"].as_array().unwrap() {
        let path = format!("/v1/drones/{}/commands/{}", command["drone"], command["id"]);
        let is_over = |now: &serde_json::Value| {
            ["accepted", "sent", "executing"].iter().all(|state| now["state"] != *state)
        };
        let over = field.until(&path, is_over).await;
        assert_eq!(over["state"], "done", "nobody else commands");
    }
    for id in [1, 2] {
        let at_rest = |state: &serde_json::Value| speed(state).abs() < 0.05;
        field.until(&format!("/v1/drones/{id}/state"), at_rest).await;
        let truth = field.truth(id);
        assert!(truth.position[0] < 20.0 && truth.flying, "{id} at {}", truth.position[0]);
    }
    let resumed = client.post(&format!("{path}/resume"), json!(null)).await.expect(409);
    assert_eq!(resumed.code(), "flight_state");
    assert_eq!(field.close().await.contacts, 0);
}
