//! The socket: events without gaps, and streams where the newest frame wins.

use std::time::Duration;

use crate::support::{
    Server,
    field::{self, Field, believes_to_be_at},
    photo,
};
use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use tokio_tungstenite::{
    MaybeTlsStream, WebSocketStream,
    tungstenite::{Message, client::IntoClientRequest},
};
use volery_api::ws::join_frame;
use volery_simulator::{DroneOptions, Flavor};

pub(crate) type Socket = WebSocketStream<MaybeTlsStream<tokio::net::TcpStream>>;

pub(crate) async fn connect(server: &Server) -> Socket {
    connect_as(server, &server.client.token.clone().unwrap()).await
}

async fn connect_as(server: &Server, token: &str) -> Socket {
    let url = format!("ws://{}/v1/ws", server.running.addr);
    let mut request = url.into_client_request().unwrap();
    // As a browser does, which cannot set other headers.
    let protocols = format!("volery, bearer.{token}");
    request.headers_mut().insert("sec-websocket-protocol", protocols.parse().unwrap());
    let (mut socket, _) = tokio_tungstenite::connect_async(request).await.unwrap();
    assert_eq!(next(&mut socket).await["type"], "hello");
    socket
}

pub(crate) async fn next(socket: &mut Socket) -> Value {
    loop {
        let message = tokio::time::timeout(Duration::from_secs(30), socket.next()).await.unwrap();
        match message.unwrap().unwrap() {
            Message::Text(text) => return serde_json::from_str(&text).unwrap(),
            Message::Ping(_) | Message::Pong(_) => {}
            other => panic!("{other:?}"),
        }
    }
}

pub(crate) async fn say(socket: &mut Socket, message: Value) {
    socket.send(Message::Text(message.to_string().into())).await.unwrap();
}

#[tokio::test]
async fn events_come_in_order_from_any_point() {
    let server = Server::start().await;
    let mut live = connect(&server).await;
    say(&mut live, json!({"type": "subscribe", "id": "s", "topic": "jobs"})).await;
    let subscribed = next(&mut live).await;
    assert_eq!((&subscribed["type"], &subscribed["re"]), (&json!("subscribed"), &json!("s")));
    let job = server.client.reconstruct(&["slow-1.jpg", "b.jpg"]).await;
    let mut seen = Vec::new();
    loop {
        let message = next(&mut live).await;
        assert_eq!((&message["type"], &message["topic"]), (&json!("event"), &json!("jobs")));
        seen.push(message["event"].clone());
        if message["event"]["data"]["state"] == "succeeded" {
            break;
        }
    }
    let numbers: Vec<_> = seen.iter().map(|event| event["seq"].as_u64().unwrap()).collect();
    assert_eq!(numbers, (1..=seen.len() as u64).collect::<Vec<_>>());

    let mut late = connect(&server).await;
    let topic = format!("job:{job}");
    say(&mut late, json!({"type": "subscribe", "topic": topic, "after": 3})).await;
    let mut again = Vec::new();
    while again.len() < seen.len() - 3 {
        let message = next(&mut late).await;
        if message["type"] == "event" {
            again.push(message["event"].clone());
        }
    }
    assert_eq!(again, seen[3..], "the past is the same for everyone");
}

#[tokio::test]
async fn odd_messages_are_answered_and_the_socket_stays() {
    let server = Server::start().await;
    let mut socket = connect(&server).await;
    for (message, code) in [
        (json!({"type": "fly"}), "invalid_body"),
        (json!({"type": "subscribe", "topic": "moon"}), "bad_topic"),
        (
            json!({"type": "stream.open", "map_id": "01900000-0000-7000-8000-000000000000"}),
            "not_found",
        ),
        (
            json!({"type": "stream.open", "map_id": "01900000-0000-7000-8000-000000000000",
            "mod": "all"}),
            "unknown_field",
        ),
        (json!({"type": "subscribe", "topic": "jobs", "afetr": 1}), "unknown_field"),
    ] {
        say(&mut socket, message.clone()).await;
        let answer = next(&mut socket).await;
        assert_eq!(
            (&answer["type"], &answer["code"]),
            (&json!("error"), &json!(code)),
            "{message}"
        );
    }
    socket.send(Message::Binary(vec![1, 2, 3].into())).await.unwrap();
    assert_eq!(next(&mut socket).await["code"], "bad_frame");
    say(&mut socket, json!({"type": "ping", "id": "7"})).await;
    let pong = next(&mut socket).await;
    assert_eq!((&pong["type"], &pong["re"]), (&json!("pong"), &json!("7")));
}

#[tokio::test]
async fn a_socket_needs_a_token() {
    let server = Server::start().await;
    let url = format!("ws://{}/v1/ws", server.running.addr);
    let error = tokio_tungstenite::connect_async(url).await.unwrap_err();
    assert!(error.to_string().contains("401"), "{error}");
    let plain = server.client.get("/v1/ws").await.expect(426);
    assert_eq!(plain.code(), "upgrade_required");
}

#[tokio::test]
async fn the_newest_frame_wins() {
    let server = Server::start().await;
    let map = server.client.map().await;
    let mut socket = connect(&server).await;
    say(&mut socket, json!({"type": "stream.open", "id": "o", "map_id": map})).await;
    let opened = next(&mut socket).await;
    assert_eq!((&opened["type"], &opened["credit"]), (&json!("stream.opened"), &json!(1)));
    let stream = opened["stream_id"].as_u64().unwrap();
    let frame = |seq: u64, words: &str| {
        let header = json!({"stream_id": stream, "seq": seq, "t_capture_ns": seq * 10});
        Message::Binary(join_frame(1, header.to_string().as_bytes(), &photo(words)).into())
    };
    // The first keeps the localizer busy; of the others only the last is worth an answer.
    for seq in 1..=5 {
        socket.send(frame(seq, "slow")).await.unwrap();
    }
    let mut answered = Vec::new();
    let mut dropped = Vec::new();
    while answered.len() + dropped.len() < 5 {
        let message = next(&mut socket).await;
        let seq = message["seq"].as_u64().unwrap();
        match message["type"].as_str().unwrap() {
            "frame.result" => {
                assert_eq!(message["result"]["status"], "ok");
                assert_eq!(message["t_capture_ns"], seq * 10);
                answered.push(seq);
            }
            "frame.dropped" => {
                assert_eq!(message["reason"], "superseded");
                dropped.push(seq);
            }
            other => panic!("{other}"),
        }
    }
    assert_eq!(answered.last(), Some(&5), "the newest frame is never dropped");
    assert!(dropped.len() >= 3, "{dropped:?}");
    assert!(answered.is_sorted() && dropped.is_sorted());

    socket.send(frame(6, "truncated")).await.unwrap();
    let bad = next(&mut socket).await;
    assert_eq!((&bad["type"], &bad["reason"]), (&json!("frame.dropped"), &json!("decode_error")));
    say(&mut socket, json!({"type": "stream.close", "stream_id": stream})).await;
    assert_eq!(next(&mut socket).await["type"], "stream.closed");
    socket.send(frame(7, "late")).await.unwrap();
    assert_eq!(next(&mut socket).await["code"], "bad_frame");
}

fn tracking_frame(stream: &Value, seq: u64, t_capture_ns: u64, words: &str) -> Message {
    let header = json!({"stream_id": stream, "seq": seq, "t_capture_ns": t_capture_ns,
        "telemetry": {"heading": 0.5, "height": 1.2}});
    Message::Binary(join_frame(1, header.to_string().as_bytes(), &photo(words)).into())
}

/// Frames of a stream go to one child, which remembers it; of streams that share a child none is
/// passed over; poses of a drone go to those who asked for them; when the child dies, the counter
/// of resets tells that what it knew is gone.
#[tokio::test]
async fn a_stream_that_tracks_keeps_its_worker() {
    let server = Server::start_with(|config| config.workers.trackers = 1).await;
    let map = server.client.map().await;
    let mut listener = connect(&server).await;
    say(&mut listener, json!({"type": "subscribe", "topic": "pose:cf1"})).await;
    assert_eq!(next(&mut listener).await["type"], "subscribed");
    let mut socket = connect(&server).await;
    let mut streams = Vec::new();
    for drone in ["cf1", "cf2"] {
        let open = json!({"type": "stream.open", "map_id": map, "track": true, "drone_id": drone});
        say(&mut socket, open).await;
        streams.push(next(&mut socket).await["stream_id"].clone());
    }
    // The first has frames without end; the second gets its turn after one of them. While the child
    // starts, a newer frame may take the place of the first.
    for seq in 1..=3 {
        socket.send(tracking_frame(&streams[0], seq, seq * 10, "slow")).await.unwrap();
    }
    socket.send(tracking_frame(&streams[1], 1, 10, "slow")).await.unwrap();
    let mut order: Vec<Value> = Vec::new();
    let last = [(&streams[0], json!(3)), (&streams[1], json!(1))];
    while !last
        .iter()
        .all(|(id, seq)| order.iter().any(|m| m["stream_id"] == **id && m["seq"] == *seq))
    {
        let message = next(&mut socket).await;
        match message["type"].as_str().unwrap() {
            "frame.tracked" => order.push(message),
            "frame.dropped" => assert_eq!(message["reason"], "superseded"),
            other => panic!("{other}"),
        }
    }
    let position = order.iter().position(|m| m["stream_id"] == streams[1]).unwrap();
    assert!(position < 2, "{order:?}");
    for message in &order {
        let latency = &message["result"]["latency"];
        let ms = |name: &str| latency[name].as_f64().unwrap();
        let steps = ["recv_ms", "decode_ms", "track_ms", "features_ms", "match_ms", "solve_ms"];
        let sum: f64 = steps.iter().map(|name| ms(name)).sum();
        assert!((sum - ms("total_ms")).abs() < 1e-6 && ms("recv_ms") > 100.0, "{latency}");
    }
    let own: Vec<_> = order.iter().filter(|m| m["stream_id"] == streams[0]).collect();
    let counts: Vec<_> = own.iter().map(|m| m["result"]["num_points"].clone()).collect();
    assert!(counts == [1] || counts == [1, 2], "one child saw them all: {counts:?}");
    let told = next(&mut listener).await;
    assert_eq!((&told["type"], &told["drone_id"]), (&json!("pose"), &json!("cf1")));
    assert_eq!(told["result"]["state"], "tracking");

    socket.send(tracking_frame(&streams[0], 7, 70, "die")).await.unwrap();
    let dropped = next(&mut socket).await;
    assert_eq!((&dropped["type"], &dropped["seq"]), (&json!("frame.dropped"), &json!(7)));
    socket.send(tracking_frame(&streams[0], 8, 80, "again")).await.unwrap();
    let again = next(&mut socket).await;
    assert_eq!(again["result"]["num_points"], 1, "a child that knows nothing");
    assert_eq!(again["result"]["reset_counter"], 1);
}

/// What the camera of a drone sees goes to the drone's estimator: a simulated drone, which knows
/// nothing but the poses it is sent, says that it is where its camera is, less the mount. Who may
/// not command drones may not feed them.
#[tokio::test]
async fn a_stream_feeds_its_drone() {
    let server = field::server().await;
    let map = server.client.map().await;
    let mount = json!({"position": [0.1, 0.0, 0.0], "orientation": [0.5, -0.5, 0.5, -0.5]});
    let drone = json!({"name": "one", "body_from_camera": mount});
    server.client.json("PUT", "/v1/drones/7", &[], drone).await.expect(200);

    let mut socket = connect(&server).await;
    let open = |map: &str, id: &str, track: bool| json!({"type": "stream.open", "map_id": map, "track": track, "drone_id": id, "feed": true});
    say(&mut socket, open(&map, "7", true)).await;
    assert_eq!(next(&mut socket).await["code"], "map_not_metric");
    let align = json!({"known_distance": {"image_a": "a.jpg", "image_b": "b.jpg", "meters": 3.0}});
    server.client.post(&format!("/v1/maps/{map}/align"), align).await.expect(201);
    for (id, track, code) in [("7", false, "not_tracked"), ("cf1", true, "bad_system_id")] {
        say(&mut socket, open(&map, id, track)).await;
        assert_eq!(next(&mut socket).await["code"], code);
    }
    let viewer = json!({"name": "guest", "role": "viewer"});
    let viewer = server.client.post("/v1/tokens", viewer).await.expect(201).json();
    let mut guest = connect_as(&server, viewer["secret"].as_str().unwrap()).await;
    say(&mut guest, open(&map, "7", true)).await;
    assert_eq!(next(&mut guest).await["code"], "forbidden");

    say(&mut socket, open(&map, "7", true)).await;
    let stream = next(&mut socket).await["stream_id"].clone();
    let drone = DroneOptions::new(7, Flavor::Px4, [0.0; 3].into());
    let field = Field::open_untold(&server, vec![drone]);
    let start = std::time::Instant::now();
    let mut shown = Value::Null;
    for seq in 1..=600 {
        let t_capture_ns = start.elapsed().as_nanos() as u64;
        socket.send(tracking_frame(&stream, seq, t_capture_ns, "fast")).await.unwrap();
        let answer = next(&mut socket).await;
        assert_eq!(answer["type"], "frame.tracked", "{answer}");
        shown = server.client.get("/v1/drones/7").await.json();
        // The camera looks along x, 10 cm before the middle.
        if believes_to_be_at(&shown, [0.9, 2.0, 0.5]) {
            assert_eq!(field.close().await.contacts, 0);
            return;
        }
        tokio::time::sleep(Duration::from_millis(50)).await;
    }
    let events = server.client.get("/v1/drones/7/events").await.expect(200).json();
    panic!("{shown}: {events}");
}
