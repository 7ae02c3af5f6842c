//! Drones over HTTP: who may, what is refused, and what a stranger on the socket achieves.

use std::net::{SocketAddr, UdpSocket};

use crate::support::Server;
use serde_json::json;
use volery_server::MavlinkSettings;

async fn server() -> Server {
    Server::start_with(|config| {
        config.mavlink = Some(MavlinkSettings::new(SocketAddr::from(([127, 0, 0, 1], 0))));
    })
    .await
}

#[tokio::test]
async fn a_service_without_a_link_says_so() {
    let server = Server::start().await;
    let answer = server.client.get("/v1/drones").await.expect(409);
    assert_eq!(answer.code(), "no_mavlink");
    assert_eq!(
        server.client.post("/v1/all-stop", json!(null)).await.expect(409).code(),
        "no_mavlink"
    );
}

#[tokio::test]
async fn drones_are_registered_and_their_keys_never_shown() {
    let server = server().await;
    let client = &server.client;
    let drone = json!({"name": "left", "signing_key": "0f".repeat(32), "vision": "odometry"});
    let made = client.json("PUT", "/v1/drones/3", &[], drone).await.expect(200);
    assert!(!String::from_utf8_lossy(&made.body).contains("0f0f"));
    let made = made.json();
    assert_eq!(made["has_own_key"], true);
    assert_eq!(made["vision"], "odometry");
    assert!(made["state"].is_null(), "it was not heard");
    let list = client.get("/v1/drones").await.expect(200).json();
    assert_eq!(list["items"].as_array().unwrap().len(), 1);
    for (id, body, code) in [
        ("4", json!({"name": "x", "signing_key": "0f"}), "bad_signing_key"),
        ("4", json!({"name": "x", "color": "red"}), "unknown_field"),
        ("0", json!({"name": "x"}), "bad_system_id"),
        ("255", json!({"name": "x"}), "bad_system_id"),
    ] {
        let path = format!("/v1/drones/{id}");
        assert_eq!(client.json("PUT", &path, &[], body).await.expect(422).code(), code);
    }
    let changed = client.json("PATCH", "/v1/drones/3", &[], json!({"name": "right"})).await;
    let changed = changed.expect(200).json();
    assert_eq!((&changed["name"], &changed["vision"]), (&json!("right"), &json!("odometry")));
    assert_eq!(changed["has_own_key"], true, "a key stays until it is replaced");
    let replaced = client.json("PUT", "/v1/drones/3", &[], json!({"name": "right"})).await;
    assert_eq!(replaced.expect(200).json()["has_own_key"], false);
    let odd = client.json("PATCH", "/v1/drones/3", &[], json!({"signing_key": "0f"})).await;
    assert_eq!(odd.expect(422).code(), "bad_signing_key");
    client.json("PATCH", "/v1/drones/4", &[], json!({"name": "x"})).await.expect(404);
    client.json("PUT", "/v1/drones/300", &[], json!({"name": "x"})).await.expect(400);
    client.delete("/v1/drones/3").await.expect(204);
    client.get("/v1/drones/3").await.expect(404);
}

#[tokio::test]
async fn only_pilots_command() {
    let server = server().await;
    let admin = &server.client;
    for (role, allowed) in [("viewer", false), ("mapper", false), ("pilot", true)] {
        let token = json!({"name": role, "role": role});
        let made = admin.post("/v1/tokens", token).await.expect(201).json();
        let client = admin.with_token(made["secret"].as_str());
        client.get("/v1/drones").await.expect(200);
        let (stop, drone) = if allowed { (200, 404) } else { (403, 403) };
        client.post("/v1/all-stop", json!(null)).await.expect(stop);
        client.post("/v1/drones/1/commands", json!({"type": "arm"})).await.expect(drone);
    }
    let stranger = admin.with_token(None);
    stranger.post("/v1/all-stop", json!(null)).await.expect(401);
}

#[tokio::test]
async fn commands_are_read_strictly() {
    let server = server().await;
    for body in [
        json!({"type": "fly_away"}),
        json!({"type": "takeoff"}),
        json!({"type": "arm", "force": true}),
        json!({"type": "goto", "position": [1.0, 2.0]}),
        json!({"type": "goto", "position": [1.0, 2.0, 3.0], "yaww": 1.0}),
    ] {
        server.client.post("/v1/drones/1/commands", body).await.expect(422);
    }
}

/// A heartbeat of ArduPilot, not signed, from a stranger.
#[tokio::test]
async fn an_unsigned_stranger_is_no_drone() {
    let server = server().await;
    let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
    let heartbeat = [0xfd, 9, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 2, 3, 81, 3, 3, 0x69, 0x8d];
    let address = server.running.mavlink_addr().unwrap();
    for bytes in [&heartbeat[..], b"garbage", &[0xfe; 300], &[]] {
        stranger.send_to(bytes, address).unwrap();
    }
    tokio::time::sleep(std::time::Duration::from_millis(200)).await;
    let list = server.client.get("/v1/drones").await.expect(200).json();
    assert_eq!(list["items"].as_array().unwrap().len(), 0);
}
