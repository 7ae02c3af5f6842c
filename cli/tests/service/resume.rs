//! An archive arrives over connections that break and a server that is killed.

use std::{
    fs::{self, File},
    io::{Read, Write},
    net::{Shutdown, SocketAddr, TcpListener, TcpStream},
    path::Path,
    process::{Command, Stdio},
    sync::{Arc, Mutex},
    time::{Duration, Instant},
};

use crate::{
    server::Server,
    support::{Folder, png, utf8},
};

/// Bytes that a connection carries to the server before it breaks.
const CUT: usize = 3 << 20;

/// Once so much is safe the server is killed.
const KILL: u64 = 5 << 20;

const NUM_PHOTOS: u32 = 8;

/// Between the program and the server: breaks connections, and knows what the server has said.
#[derive(Clone)]
struct Line {
    /// `None` while there is no server.
    server: Arc<Mutex<Option<SocketAddr>>>,
    said: Arc<Mutex<Vec<u8>>>,
    num_cuts: Arc<Mutex<usize>>,
}

impl Line {
    /// Answers the address to talk to.
    fn open(server: SocketAddr) -> (Self, SocketAddr) {
        let line = Self {
            server: Arc::new(Mutex::new(Some(server))),
            said: Arc::default(),
            num_cuts: Arc::default(),
        };
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let there = line.clone();
        std::thread::spawn(move || {
            for stream in listener.incoming().flatten() {
                let line = there.clone();
                std::thread::spawn(move || line.carry(stream));
            }
        });
        (line, address)
    }

    fn carry(&self, program: TcpStream) {
        let Some(server) = *self.server.lock().unwrap() else { return };
        let Ok(server) = TcpStream::connect(server) else { return };
        let (mut back_from, mut back_to) =
            (server.try_clone().unwrap(), program.try_clone().unwrap());
        let said = Arc::clone(&self.said);
        let back = std::thread::spawn(move || {
            let mut buffer = [0; 4096];
            while let Ok(len @ 1..) = back_from.read(&mut buffer) {
                said.lock().unwrap().extend_from_slice(&buffer[..len]);
                if back_to.write_all(&buffer[..len]).is_err() {
                    break;
                }
            }
            let _ = back_to.shutdown(Shutdown::Both);
        });
        let (mut from, mut to) = (&program, &server);
        let (mut carried, mut buffer) = (0, [0; 16 << 10]);
        while let Ok(len @ 1..) = from.read(&mut buffer) {
            carried += len;
            if carried > CUT {
                *self.num_cuts.lock().unwrap() += 1;
                break;
            }
            if to.write_all(&buffer[..len]).is_err() {
                break;
            }
        }
        let _ = (program.shutdown(Shutdown::Both), server.shutdown(Shutdown::Both));
        let _ = back.join();
    }

    /// The path of the upload, and how much of it the server has acknowledged.
    fn acknowledged(&self) -> Option<(String, u64)> {
        let said = self.said.lock().unwrap();
        let said = String::from_utf8_lossy(&said);
        let (before, after) = said.rsplit_once("\"offset\":")?;
        let (_, id) = before.rsplit_once("{\"id\":\"")?;
        let offset = after.split_once(',')?.0.parse().ok()?;
        Some((format!("/v1/uploads/{}", id.split_once('"')?.0), offset))
    }
}

/// A photo of noise, which does not pack.
fn noise(seed: u32) -> Vec<u8> {
    let mut state = seed;
    let pixels: Vec<u8> = (0..1600 * 1000)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        })
        .collect();
    png(&pixels, 1600, 1000)
}

fn write_archive(path: &Path) {
    let mut zip = zip::ZipWriter::new(File::create(path).unwrap());
    let stored =
        zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for number in 0..NUM_PHOTOS {
        zip.start_file(format!("{number}.png"), stored).unwrap();
        zip.write_all(&noise(number)).unwrap();
    }
    zip.finish().unwrap();
}

fn address(server: &Server) -> SocketAddr {
    server.url.strip_prefix("http://").unwrap().parse().unwrap()
}

#[test]
fn an_archive_arrives_over_broken_connections_and_a_killed_server() {
    let folder = Folder::new("resume");
    let archive = folder.join("photos.zip");
    write_archive(&archive);
    assert!(fs::metadata(&archive).unwrap().len() > 2 * KILL);
    let data = folder.join("data");
    let mut server = Server::start(&data);
    let (line, front) = Line::open(address(&server));
    let program = Command::new(env!("CARGO_BIN_EXE_volery"))
        .args(["--json", "upload", utf8(&archive), "--server", &format!("http://{front}")])
        .args(["--token", &server.token])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();

    let deadline = Instant::now() + Duration::from_secs(120);
    while line.acknowledged().is_none_or(|(_, offset)| offset < KILL) {
        assert!(Instant::now() < deadline, "{:?}", line.acknowledged());
        std::thread::sleep(Duration::from_millis(5));
    }
    *line.server.lock().unwrap() = None;
    server.kill();
    let (upload, acknowledged) = line.acknowledged().unwrap();
    server = Server::start(&data);

    let runtime = tokio::runtime::Runtime::new().unwrap();
    runtime.block_on(async {
        let request = reqwest::Client::new().get(format!("{}{upload}", server.url));
        let answer = request.bearer_auth(&server.token).send().await.unwrap();
        let state: serde_json::Value = answer.json().await.unwrap();
        assert!(state["offset"].as_u64().unwrap() >= acknowledged, "{acknowledged} {state:#}");
    });
    *line.server.lock().unwrap() = Some(address(&server));

    let output = program.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let answer: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(*line.num_cuts.lock().unwrap() > 1, "the line was cut");
    runtime.block_on(async {
        let client = server.client();
        let set = answer["imageset_id"].as_str().unwrap().parse().unwrap();
        let images = client.images(set).await.unwrap();
        assert_eq!(images.len(), NUM_PHOTOS as usize);
        for image in images {
            let number = image.name.strip_suffix(".png").unwrap().parse().unwrap();
            assert!(client.image_bytes(image.id).await.unwrap() == noise(number), "{}", image.name);
        }
    });
}
