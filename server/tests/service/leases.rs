//! Leases of drones, and what sockets are told of drones, with simulated drones in the air.

use std::time::Duration;

use crate::support::{Client, Server, field, field::Field};
use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use tokio_tungstenite::{
    MaybeTlsStream, WebSocketStream, connect_async,
    tungstenite::{Message, client::IntoClientRequest},
};
use volery_simulator::{DroneOptions, Flavor};

type Socket = WebSocketStream<MaybeTlsStream<tokio::net::TcpStream>>;

async fn open(server: &Server, client: &Client) -> Socket {
    let url = format!("ws://{}/v1/ws", server.running.addr);
    let mut request = url.into_client_request().unwrap();
    let protocols = format!("volery, bearer.{}", client.token.clone().unwrap());
    request.headers_mut().insert("sec-websocket-protocol", protocols.parse().unwrap());
    let (mut socket, _) = connect_async(request).await.unwrap();
    until(&mut socket, |message| message["type"] == "hello").await;
    socket
}

/// Says something; the next message is the answer.
async fn ask(socket: &mut Socket, message: Value) -> Value {
    socket.send(Message::Text(message.to_string().into())).await.unwrap();
    until(socket, |_| true).await
}

async fn listen(server: &Server, topic: &str) -> Socket {
    let mut socket = open(server, &server.client).await;
    ask(&mut socket, json!({"type": "subscribe", "topic": topic})).await;
    socket
}

/// The first message that is wanted.
async fn until(socket: &mut Socket, wanted: impl Fn(&Value) -> bool) -> Value {
    let find = async {
        loop {
            if let Message::Text(text) = socket.next().await.unwrap().unwrap() {
                let message: Value = serde_json::from_str(&text).unwrap();
                if wanted(&message) {
                    return message;
                }
            }
        }
    };
    tokio::time::timeout(Duration::from_secs(60), find).await.unwrap()
}

fn drones() -> Vec<DroneOptions> {
    let drone =
        |id: u8, flavor| DroneOptions::new(id, flavor, [0.0, 2.0 * f64::from(id), 0.0].into());
    vec![drone(1, Flavor::ArduPilot), drone(2, Flavor::Px4)]
}

/// A drone under way stops when the one who promised to be there is not; who has the lease
/// commands, nobody else does, and everybody may stop all.
#[tokio::test]
async fn a_lease_binds_its_drones() {
    let server = field::server().await;
    let field = Field::open(&server, drones());
    field.take_off(&[1, 2], 1.5).await;
    let (ann, bob) = (server.client.pilot("ann").await, server.client.pilot("bob").await);
    let mut alerts = listen(&server, "alerts").await;
    let mut states = listen(&server, "drone:1").await;

    let request = json!({"drones": [1], "ttl_ms": 60_000});
    let lease = ann.post("/v1/leases", request.clone()).await.expect(201);
    let path = lease.header("location").unwrap().to_owned();
    assert_eq!((&lease.json()["holder"], &lease.json()["drones"]), (&json!("ann"), &json!([1])));
    let far = json!({"type": "goto", "position": [20.0, 2.0, 1.5]});
    let refused = bob.post("/v1/drones/1/commands", far.clone()).await.expect(409);
    assert_eq!(refused.code(), "drone_leased");
    assert!(refused.json()["detail"].as_str().unwrap().contains("ann"));
    assert_eq!(bob.post("/v1/leases", request.clone()).await.expect(409).code(), "drone_leased");
    assert_eq!(ann.post("/v1/leases", request).await.expect(409).code(), "drone_leased");
    let renew = format!("{path}/renew");
    assert_eq!(bob.post(&renew, json!(null)).await.expect(409).code(), "not_lease_holder");
    assert_eq!(bob.delete(&path).await.expect(409).code(), "not_lease_holder");
    bob.post("/v1/drones/2/commands", json!({"type": "hold"})).await.expect(202);

    let command = ann.post("/v1/drones/1/commands", far).await.expect(202).json();
    let executing = |message: &Value| {
        message["type"] == "command.state" && message["command"]["state"] == "executing"
    };
    assert_eq!(until(&mut states, executing).await["command"]["id"], command["id"]);
    let moves = |message: &Value| {
        message["state"]["estimate"]["velocity"][0].as_f64().is_some_and(|speed| speed > 0.3)
    };
    assert_eq!(until(&mut states, moves).await["type"], "drone.state");

    // Given back: the drone stops on its way.
    ann.delete(&path).await.expect(204);
    let over = until(&mut alerts, |message| message["alert"]["code"] == "lease_over").await;
    assert_eq!((&over["alert"]["drone"], &over["alert"]["detail"]), (&json!(1), &json!("holds")));
    field
        .until("/v1/drones/1/state", |state| {
            let velocity = &state["estimate"]["velocity"];
            (0..3).all(|axis| velocity[axis].as_f64().unwrap().abs() < 0.1)
        })
        .await;
    assert!(field.truth(1).position[0] < 15.0);
    assert_eq!(ann.post(&renew, json!(null)).await.expect(404).code(), "not_found");

    // Whoever takes it then flies it, until the time of the lease is over.
    let short = json!({"drones": [2, 1, 2], "ttl_ms": 300});
    let lease = bob.post("/v1/leases", short).await.expect(201).json();
    assert_eq!(lease["drones"], json!([1, 2]));
    let both = until(&mut alerts, |message| message["alert"]["code"] == "lease_over").await;
    assert_eq!(both["alert"]["detail"], "holds");
    assert_eq!(server.client.get("/v1/leases").await.expect(200).json()["items"], json!([]));

    ann.post("/v1/leases", json!({"drones": [1, 2], "ttl_ms": 60_000})).await.expect(201);
    let stopped = bob.post("/v1/all-stop", json!(null)).await.expect(200).json();
    assert_eq!(stopped["commands"].as_array().unwrap().len(), 2);
    assert_eq!(field.close().await.contacts, 0);
}

/// A lease that was taken over a socket is over when the socket is, however that ends.
#[tokio::test]
async fn a_lease_ends_with_its_socket() {
    let server = field::server().await;
    let field = Field::open(&server, drones());
    field.take_off(&[1, 2], 1.5).await;
    let ann = server.client.pilot("ann").await;
    let mut alerts = listen(&server, "alerts").await;
    let mut pilot = open(&server, &ann).await;
    let lease = json!({"type": "lease", "drones": [1], "ttl_ms": 60_000});
    let leased = ask(&mut pilot, lease.clone()).await;
    assert_eq!((&leased["type"], &leased["lease"]["holder"]), (&json!("leased"), &json!("ann")));
    let lease_id = &leased["lease"]["id"];
    let listed = ann.get("/v1/leases").await.expect(200).json();
    assert_eq!(
        (&listed["items"][0]["id"], listed["items"].as_array().unwrap().len()),
        (lease_id, 1)
    );
    assert_eq!(ask(&mut pilot, lease.clone()).await["code"], "drone_leased");
    let renewed = ask(&mut pilot, json!({"type": "lease.renew", "lease_id": lease_id})).await;
    assert_eq!(renewed["lease"]["id"], *lease_id);
    let released = ask(&mut pilot, json!({"type": "lease.release", "lease_id": lease_id})).await;
    assert_eq!((&released["type"], &released["lease_id"]), (&json!("lease.released"), lease_id));
    let gone = ask(&mut pilot, json!({"type": "lease.renew", "lease_id": lease_id})).await;
    assert_eq!(gone["code"], "not_found");

    // Under way when the line is cut: no word of good-bye.
    assert_eq!(ask(&mut pilot, lease.clone()).await["type"], "leased");
    let far = json!({"type": "goto", "position": [20.0, 2.0, 1.5]});
    ann.post("/v1/drones/1/commands", far).await.expect(202);
    let moves = |state: &Value| state["estimate"]["velocity"][0].as_f64().unwrap() > 0.3;
    field.until("/v1/drones/1/state", moves).await;
    let cut = tokio::time::Instant::now();
    drop(pilot);
    until(&mut alerts, |message| message["alert"]["code"] == "lease_over").await;
    assert!(cut.elapsed() < Duration::from_secs(10), "the promise was for a minute");
    let stands = |state: &Value| {
        let velocity = &state["estimate"]["velocity"];
        (0..3).all(|axis| velocity[axis].as_f64().unwrap().abs() < 0.1)
    };
    field.until("/v1/drones/1/state", stands).await;
    assert!(field.truth(1).position[0] < 15.0);
    assert_eq!(ann.get("/v1/leases").await.expect(200).json()["items"], json!([]));

    let viewer = json!({"name": "eve", "role": "viewer"});
    let eve = server.client.post("/v1/tokens", viewer).await.expect(201).json();
    let mut eve = open(&server, &server.client.with_token(eve["secret"].as_str())).await;
    assert_eq!(ask(&mut eve, lease).await["code"], "forbidden");
    let audit = || server.client.get("/v1/audit?limit=1000");
    let over_sockets = |items: &Value| {
        let entries = items.as_array().unwrap().iter().filter(|entry| entry["method"] == "WS");
        entries.map(|e| (e["name"].clone(), e["status"].clone())).collect::<Vec<_>>()
    };
    // Entries are written a little later than they are made; newest first.
    let mut entries = Vec::new();
    while entries.len() < 6 {
        tokio::time::sleep(Duration::from_millis(20)).await;
        entries = over_sockets(&audit().await.expect(200).json()["items"]);
    }
    let expected =
        [("eve", 403), ("ann", 200), ("ann", 200), ("ann", 200), ("ann", 409), ("ann", 200)];
    assert_eq!(entries, expected.map(|(name, status)| (json!(name), json!(status))));
    assert_eq!(field.close().await.contacts, 0);
}

#[tokio::test]
async fn leases_are_read_strictly() {
    let server = field::server().await;
    let client = &server.client;
    let lease = |request: Value| client.post("/v1/leases", request);
    assert_eq!(lease(json!({"drones": [9], "ttl_ms": 1000})).await.expect(404).code(), "not_found");
    for (drones, ttl_ms) in [(json!([]), 1000), (json!([1]), 0), (json!([1]), 3_600_000)] {
        let answer = lease(json!({"drones": drones, "ttl_ms": ttl_ms})).await.expect(422);
        assert_eq!(answer.code(), "bad_lease");
    }
    let typo = lease(json!({"drones": [1], "ttl_ms": 1000, "ttl": 1})).await.expect(422);
    assert_eq!(typo.code(), "unknown_field");
}

/// A topic that is none, and a service without drones, are answered.
#[tokio::test]
async fn topics_of_drones_are_named_by_numbers() {
    let server = field::server().await;
    let code = async |server: &Server, topic: &str| {
        let mut socket = open(server, &server.client).await;
        ask(&mut socket, json!({"type": "subscribe", "topic": topic})).await["code"].clone()
    };
    for topic in ["drone:cf1", "drone:300", "alerts:1", "drone"] {
        assert_eq!(code(&server, topic).await, "bad_topic", "{topic}");
    }
    assert_eq!(code(&server, "drone:*").await, Value::Null);
    let without = Server::start().await;
    for topic in ["drone:1", "alerts"] {
        assert_eq!(code(&without, topic).await, "no_mavlink", "{topic}");
    }
}
