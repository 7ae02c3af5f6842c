//! The socket: events without gaps, and streams where the newest frame wins.

mod support;

use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use support::{Server, photo};
use tokio_tungstenite::{
    MaybeTlsStream, WebSocketStream,
    tungstenite::{Message, client::IntoClientRequest},
};
use volery_api::ws::join_frame;

type Socket = WebSocketStream<MaybeTlsStream<tokio::net::TcpStream>>;

async fn connect(server: &Server) -> Socket {
    let url = format!("ws://{}/v1/ws", server.running.addr);
    let mut request = url.into_client_request().unwrap();
    let token = server.client.token.clone().unwrap();
    // As a browser does, which cannot set other headers.
    let protocols = format!("volery, bearer.{token}");
    request.headers_mut().insert("sec-websocket-protocol", protocols.parse().unwrap());
    let (mut socket, _) = tokio_tungstenite::connect_async(request).await.unwrap();
    assert_eq!(next(&mut socket).await["type"], "hello");
    socket
}

async fn next(socket: &mut Socket) -> Value {
    loop {
        let message = tokio::time::timeout(Duration::from_secs(30), socket.next()).await.unwrap();
        match message.unwrap().unwrap() {
            Message::Text(text) => return serde_json::from_str(&text).unwrap(),
            Message::Ping(_) | Message::Pong(_) => {}
            other => panic!("{other:?}"),
        }
    }
}

async fn say(socket: &mut Socket, message: Value) {
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
