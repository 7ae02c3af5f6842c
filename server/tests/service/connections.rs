//! Connections: limited, closed when their sender is too slow, kept and answered when it is not.

use std::{
    io::{Read, Write},
    net::TcpStream,
    time::{Duration, Instant},
};

use crate::support::{Server, field};

/// hyper keeps half a header for ever unless it is given a timer.
#[tokio::test]
async fn half_a_header_is_closed() {
    let server = Server::start_with(|config| config.limits.header_timeout_s = 1).await;
    let addr = server.running.addr;
    let waited = tokio::task::spawn_blocking(move || {
        let mut stream = TcpStream::connect(addr).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        stream.write_all(b"GET /healthz HTTP/1.1\r\nHost: x\r\nX-Slow: ").unwrap();
        let start = Instant::now();
        let mut rest = Vec::new();
        stream.read_to_end(&mut rest).unwrap();
        start.elapsed()
    });
    assert!(waited.await.unwrap() < Duration::from_secs(10));
}

#[tokio::test]
async fn a_body_that_pauses_is_given_up() {
    let server = Server::start_with(|config| config.limits.body_idle_timeout_s = 1).await;
    let token = server.client.token.clone().unwrap();
    let head = format!(
        "POST /v1/imagesets HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {token}\r\n\
         Content-Type: application/json\r\nContent-Length: 100\r\n\r\n{{"
    );
    let answer = server.client.raw(head.into_bytes()).await.expect(408);
    assert_eq!(answer.code(), "request_timeout");
}

/// Each byte comes in time, all of them never.
#[tokio::test]
async fn a_body_that_trickles_is_given_up() {
    let server = Server::start_with(|config| {
        config.limits.body_idle_timeout_s = 1;
        config.limits.body_min_bytes_per_s = 1000;
    })
    .await;
    let (addr, token) = (server.running.addr, server.client.token.clone().unwrap());
    let answer = tokio::task::spawn_blocking(move || {
        let mut stream = TcpStream::connect(addr).unwrap();
        stream.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
        let head = format!(
            "POST /v1/imagesets HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {token}\r\n\
             Content-Type: application/json\r\nContent-Length: 10000\r\n\r\n{{"
        );
        stream.write_all(head.as_bytes()).unwrap();
        let start = Instant::now();
        let mut answer = [0; 12];
        // The pause between two bytes is the time-out of the read.
        while stream.read_exact(&mut answer).is_err() {
            assert!(start.elapsed() < Duration::from_secs(20), "it waits for ever");
            let _ = stream.write_all(b" ");
        }
        String::from_utf8_lossy(&answer).into_owned()
    });
    assert_eq!(answer.await.unwrap(), "HTTP/1.1 408");
}

/// Reads one answer with a body of known length off a connection that stays open.
fn read_answer(stream: &mut TcpStream) -> String {
    let mut head = Vec::new();
    let mut byte = [0];
    while !head.ends_with(b"\r\n\r\n") {
        stream.read_exact(&mut byte).expect("the connection was closed");
        head.push(byte[0]);
    }
    let head = String::from_utf8(head).unwrap().to_ascii_lowercase();
    let (_, length) = head.split_once("content-length: ").expect("a length");
    let length = length.split("\r\n").next().unwrap().parse().unwrap();
    stream.read_exact(&mut vec![0; length]).unwrap();
    head
}

/// Some libraries send `null` with every POST, in a packet after the head's.
#[tokio::test]
async fn a_body_that_nobody_asked_for_leaves_the_connection_usable() {
    let server = field::server().await;
    let (addr, token) = (server.running.addr, server.client.token.clone().unwrap());
    let asked = tokio::task::spawn_blocking(move || {
        let mut stream = TcpStream::connect(addr).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        for (method, path, status) in [
            ("POST", "/v1/all-stop", "200"),
            ("GET", "/v1/jobs", "200"),
            ("POST", "/v1/all-stop", "200"),
            ("POST", "/v1/nowhere", "404"),
            ("GET", "/healthz", "200"),
        ] {
            let head = format!(
                "{method} {path} HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {token}\r\n\
                 Content-Type: application/json\r\nContent-Length: 4\r\n\r\n"
            );
            stream.write_all(head.as_bytes()).unwrap();
            // Answered at once: an all-stop does not wait for it.
            let answer = read_answer(&mut stream);
            assert!(answer.starts_with(&format!("http/1.1 {status}")), "{method} {path}: {answer}");
            stream.write_all(b"null").unwrap();
        }
    });
    asked.await.unwrap();
}

/// Who sends everything before it listens hears why it was refused, not a broken pipe.
#[tokio::test]
async fn a_refusal_is_heard_by_who_is_still_sending() {
    let server = Server::start_with(|config| config.limits.json_bytes = 1000).await;
    let (addr, token) = (server.running.addr, server.client.token.clone().unwrap());
    let asked = tokio::task::spawn_blocking(move || {
        let mut stream = TcpStream::connect(addr).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        for (token, status) in [(token.as_str(), "413"), ("wrong", "401")] {
            let head = format!(
                "POST /v1/imagesets HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {token}\r\n\
                 Content-Type: application/json\r\nContent-Length: {}\r\n\r\n",
                16 << 20
            );
            stream.write_all(head.as_bytes()).unwrap();
            for _ in 0..16 {
                stream.write_all(&[b' '; 1 << 20]).expect("the connection was closed");
            }
            let answer = read_answer(&mut stream);
            assert!(answer.starts_with(&format!("http/1.1 {status}")), "{answer}");
        }
    });
    asked.await.unwrap();
}

/// Who announces much and only listens hears the answer, and holds no connection for it.
#[tokio::test]
async fn a_body_that_never_comes_is_not_waited_for() {
    let server = Server::start().await;
    let addr = server.running.addr;
    let asked = tokio::task::spawn_blocking(move || {
        let mut stream = TcpStream::connect(addr).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        let head = b"POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Length: 100\r\n\r\n";
        stream.write_all(head).unwrap();
        assert!(read_answer(&mut stream).starts_with("http/1.1 401"));
        let start = Instant::now();
        stream.read_to_end(&mut Vec::new()).expect("it is not closed");
        start.elapsed()
    });
    assert!(asked.await.unwrap() < Duration::from_secs(15));
}

#[tokio::test]
async fn connections_over_the_limit_are_closed_and_others_go_on() {
    let server = Server::start_with(|config| config.limits.connections = 2).await;
    let addr = server.running.addr;
    let held: Vec<_> = (0..2).map(|_| TcpStream::connect(addr).unwrap()).collect();
    let start = Instant::now();
    while server.client.get("/healthz").await.status != 0 {
        assert!(start.elapsed() < Duration::from_secs(10), "a third connection was served");
    }
    drop(held);
    while server.client.get("/healthz").await.status != 200 {
        assert!(start.elapsed() < Duration::from_secs(10), "places come back");
    }
}
