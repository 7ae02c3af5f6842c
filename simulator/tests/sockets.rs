//! Drones on real sockets of the loopback.

use std::time::Duration;

use nalgebra::Point3;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpStream, UdpSocket};
use tokio::sync::{mpsc, oneshot};
use volery_geometry::{Camera, CameraModel};
use volery_simulator::shell::{Feed, FrameSink, Line, Simulation, simulate};
use volery_simulator::*;
use volery_synthetic::Hall;

fn simulation(server: &UdpSocket) -> Simulation {
    let drone = |id, flavor, y| DroneOptions::new(id, flavor, Point3::new(0.0, y, 0.0));
    Simulation {
        server: server.local_addr().unwrap(),
        bind: [127, 0, 0, 1].into(),
        drones: vec![drone(11, Flavor::ArduPilot, 0.0), drone(12, Flavor::Px4, 1.0)],
        space: Space::Open,
        separation: 0.5,
        faults: Vec::new(),
        feed: None,
        report_interval: Duration::from_millis(50),
    }
}

/// Each drone speaks from a port of its own, and the states of all are told.
#[tokio::test]
async fn drones_speak_from_ports_of_their_own() {
    let server = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let (stop, stopped) = oneshot::channel::<()>();
    let lines = std::sync::Mutex::new(Vec::new());
    let run = simulate(simulation(&server), async { drop(stopped.await) }, |line| {
        if let Line::State(state) = line {
            lines.lock().unwrap().push(state.system_id);
        }
    });
    let listen = async {
        let (mut buffer, mut heard) = ([0; 512], std::collections::BTreeMap::new());
        while heard.len() < 2 {
            let (len, from) = server.recv_from(&mut buffer).await.unwrap();
            let mut link = Link::new(255, 190, None);
            for received in link.decode(&buffer[..len], Duration::ZERO) {
                heard.insert(received.unwrap().system_id, from.port());
            }
        }
        stop.send(()).unwrap();
        heard
    };
    let (summary, heard) = tokio::join!(run, listen);
    assert_eq!(heard.keys().copied().collect::<Vec<_>>(), [11, 12]);
    assert_ne!(heard[&11], heard[&12]);
    let summary = summary.unwrap();
    assert_eq!((summary.drones, summary.contacts), (2, 0));
    assert!(lines.lock().unwrap().contains(&12));
}

/// A viewer gets whole JPEG pictures, each with the time it was taken at.
#[tokio::test]
async fn pictures_are_served_as_motion_jpeg() {
    let server = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let camera = Camera::from_focal(CameraModel::Pinhole, 96, 72, 70.0).unwrap();
    let scenery = Scenery::Hall(Box::new(Hall::standard(0.05, 1)));
    let feed = Feed {
        eye: Eye::new(scenery, &camera, Mount::default()),
        interval: Duration::from_millis(20),
        sink: FrameSink::Mjpeg("127.0.0.1:0".parse().unwrap()),
    };
    let (tell, mut told) = mpsc::unbounded_channel();
    let (stop, stopped) = oneshot::channel::<()>();
    let simulation = Simulation { feed: Some(feed), ..simulation(&server) };
    let run = simulate(simulation, async { drop(stopped.await) }, |line| {
        if let Line::Camera { camera_url, .. } = line {
            tell.send(camera_url.clone()).unwrap();
        }
    });
    let watch = async {
        let url = told.recv().await.unwrap();
        let address = url.strip_prefix("http://").unwrap().strip_suffix("/stream").unwrap();
        let mut socket = TcpStream::connect(address).await.unwrap();
        socket.write_all(b"GET /stream HTTP/1.1\r\nHost: x\r\n\r\n").await.unwrap();
        let mut bytes = Vec::new();
        let boundary = b"--frame\r\n";
        while bytes.windows(boundary.len()).filter(|w| w == boundary).count() < 3 {
            assert_ne!(socket.read_buf(&mut bytes).await.unwrap(), 0);
        }
        stop.send(()).unwrap();
        bytes
    };
    let (summary, bytes) = tokio::join!(run, watch);
    summary.unwrap();
    let text = String::from_utf8_lossy(&bytes);
    assert!(text.starts_with("HTTP/1.1 200 OK\r\n") && text.contains("boundary=frame"));
    let part = text.split("--frame\r\n").nth(1).unwrap();
    let field = |name: &str| {
        let line = part.lines().find_map(|line| line.strip_prefix(name)).unwrap();
        line.trim().parse::<f64>().unwrap()
    };
    assert!(field("X-Timestamp:") > 1e9);
    let head = b"\r\n\r\n";
    let first = bytes.windows(9).position(|w| w == b"--frame\r\n").unwrap();
    let start = first + bytes[first..].windows(4).position(|w| w == head).unwrap() + 4;
    let picture = &bytes[start..start + field("Content-Length:") as usize];
    assert!(picture.starts_with(&[0xff, 0xd8]) && picture.ends_with(&[0xff, 0xd9]));
}
