//! A service over a folder of its own, and a client that speaks plain HTTP to it.

pub(crate) mod camera;
pub(crate) mod field;
pub(crate) mod peers;

use std::{
    io::{Read, Write},
    net::{SocketAddr, TcpStream},
    path::{Path, PathBuf},
    process::Command,
    sync::atomic::{AtomicU32, Ordering},
    time::{Duration, Instant},
};

use serde_json::{Value, json};
use volery_server::{Config, RunningServer};

/// A folder that is deleted at the end of the test.
pub(crate) struct Folder(pub PathBuf);

impl Folder {
    pub(crate) fn new() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("volery-server-{}-{number}", std::process::id());
        let path = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Settings for tests: a free port, the fake worker, and little patience.
pub(crate) fn config(data: &Path) -> Config {
    let mut config = Config::new(data, env!("CARGO_BIN_EXE_fake-worker"));
    config.listen.set_port(0);
    config.jobs.backoff = vec![Duration::from_millis(10)];
    config.jobs.cancel_grace = Duration::from_secs(2);
    config.workers.decode_timeout = Duration::from_secs(2);
    config
}

pub(crate) struct Server {
    pub(crate) running: RunningServer,
    pub(crate) client: Client,
    pub(crate) folder: Folder,
}

impl Server {
    pub(crate) async fn start() -> Self {
        Self::start_with(|_| {}).await
    }

    pub(crate) async fn start_with(change: impl FnOnce(&mut Config)) -> Self {
        let folder = Folder::new();
        let mut config = config(&folder.0.join("data"));
        change(&mut config);
        let running = volery_server::start(config).await.unwrap();
        let client = Client { addr: running.addr, token: running.admin_token.clone() };
        Self { running, client, folder }
    }
}

/// One answer.
#[derive(Debug)]
pub(crate) struct Answer {
    pub(crate) status: u16,
    pub(crate) head: String,
    pub(crate) body: Vec<u8>,
}

impl Answer {
    pub(crate) fn json(&self) -> Value {
        serde_json::from_slice(&self.body)
            .unwrap_or_else(|e| panic!("{e}: {}", String::from_utf8_lossy(&self.body)))
    }

    pub(crate) fn code(&self) -> String {
        assert!(self.header("content-type").is_some_and(|t| t == "application/problem+json"));
        let problem = self.json();
        assert_eq!(problem["status"], self.status);
        problem["code"].as_str().unwrap().to_owned()
    }

    pub(crate) fn header(&self, name: &str) -> Option<&str> {
        self.head.lines().skip(1).find_map(|line| {
            let (key, value) = line.split_once(':')?;
            key.eq_ignore_ascii_case(name).then(|| value.trim())
        })
    }

    /// The answer itself, once its status is right.
    #[track_caller]
    pub(crate) fn expect(self, status: u16) -> Self {
        let text = String::from_utf8_lossy(&self.body);
        assert_eq!(self.status, status, "{}\n{text}", self.head);
        self
    }
}

/// One connection per request.
#[derive(Debug, Clone)]
pub(crate) struct Client {
    pub(crate) addr: SocketAddr,
    pub(crate) token: Option<String>,
}

impl Client {
    pub(crate) fn with_token(&self, token: Option<&str>) -> Self {
        Self { addr: self.addr, token: token.map(str::to_owned) }
    }

    /// A pilot of this name, with a token that this admin makes.
    pub(crate) async fn pilot(&self, name: &str) -> Self {
        let token = json!({"name": name, "role": "pilot"});
        let made = self.post("/v1/tokens", token).await.expect(201).json();
        self.with_token(made["secret"].as_str())
    }

    pub(crate) async fn send(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        body: &[u8],
    ) -> Answer {
        let mut text = format!(
            "{method} {path} HTTP/1.1\r\nHost: test\r\nConnection: close\r\nContent-Length: {}\r\n",
            body.len()
        );
        if let Some(token) = &self.token {
            text.push_str(&format!("Authorization: Bearer {token}\r\n"));
        }
        for (name, value) in headers {
            text.push_str(&format!("{name}: {value}\r\n"));
        }
        text.push_str("\r\n");
        let mut bytes = text.into_bytes();
        bytes.extend_from_slice(body);
        self.raw(bytes).await
    }

    /// Sends bytes and reads to the end of the connection.
    pub(crate) async fn raw(&self, bytes: Vec<u8>) -> Answer {
        let addr = self.addr;
        tokio::task::spawn_blocking(move || {
            let mut stream = TcpStream::connect(addr).unwrap();
            stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
            // A connection over the limit is closed unread: status 0.
            let _ = stream.write_all(&bytes);
            let mut answer = Vec::new();
            let _ = stream.read_to_end(&mut answer);
            parse(&answer)
        })
        .await
        .unwrap()
    }

    pub(crate) async fn get(&self, path: &str) -> Answer {
        self.send("GET", path, &[], b"").await
    }

    pub(crate) async fn delete(&self, path: &str) -> Answer {
        self.send("DELETE", path, &[], b"").await
    }

    pub(crate) async fn post(&self, path: &str, body: Value) -> Answer {
        self.json("POST", path, &[], body).await
    }

    pub(crate) async fn json(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        body: Value,
    ) -> Answer {
        let mut headers = headers.to_vec();
        headers.push(("Content-Type", "application/json"));
        self.send(method, path, &headers, body.to_string().as_bytes()).await
    }

    pub(crate) async fn upload(&self, set: &str, files: &[(&str, &[u8])]) -> Answer {
        let path = format!("/v1/imagesets/{set}/images");
        let kind = [("Content-Type", "multipart/form-data; boundary=cut")];
        self.send("POST", &path, &kind, &multipart(files)).await
    }

    /// A set with photos of these names.
    pub(crate) async fn imageset(&self, names: &[&str]) -> String {
        let set = self.post("/v1/imagesets", json!({"name": "hall"})).await.expect(201).json();
        let set = set["id"].as_str().unwrap().to_owned();
        let files: Vec<_> = names.iter().map(|name| (*name, photo(name))).collect();
        let files: Vec<_> = files.iter().map(|(name, bytes)| (*name, &bytes[..])).collect();
        self.upload(&set, &files).await.expect(200);
        set
    }

    pub(crate) async fn reconstruct(&self, names: &[&str]) -> String {
        let set = self.imageset(names).await;
        let job = self.post("/v1/jobs", json!({"imageset_ids": [set]})).await.expect(202).json();
        job["id"].as_str().unwrap().to_owned()
    }

    pub(crate) async fn job(&self, id: &str) -> Value {
        self.get(&format!("/v1/jobs/{id}")).await.expect(200).json()
    }

    /// The job once it is in one of these states.
    pub(crate) async fn wait_for(&self, id: &str, states: &[&str]) -> Value {
        let start = Instant::now();
        loop {
            let job = self.job(id).await;
            if states.contains(&job["state"].as_str().unwrap()) {
                return job;
            }
            assert!(start.elapsed() < Duration::from_secs(60), "still {job:#}");
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }

    pub(crate) async fn finished(&self, id: &str) -> Value {
        self.wait_for(id, &["succeeded", "partial", "failed", "cancelled"]).await
    }

    /// Id of a finished map.
    pub(crate) async fn map(&self) -> String {
        let job = self.reconstruct(&["a.jpg", "b.jpg"]).await;
        let job = self.finished(&job).await;
        assert_eq!(job["state"], "succeeded", "{job:#}");
        job["outputs"]["map_id"].as_str().unwrap().to_owned()
    }
}

/// A Python with `modules`, as after `import`, or `None`, said aloud.
pub(crate) fn python(modules: &str) -> Option<PathBuf> {
    let target = Path::new(env!("CARGO_BIN_EXE_fake-worker")).parent()?.parent()?;
    let pythons = [target.join("pymavlink/bin/python"), PathBuf::from("python3")];
    let python = pythons.into_iter().find(|python| {
        let check = Command::new(python).args(["-c", &format!("import {modules}")]).output();
        check.is_ok_and(|output| output.status.success())
    });
    if python.is_none() {
        eprintln!("SKIPPED: no Python with {modules}; ./run test installs one");
    }
    python
}

/// What the fake worker takes for a photo.
pub(crate) fn photo(words: &str) -> Vec<u8> {
    [b"\xff\xd8\xff", words.as_bytes()].concat()
}

pub(crate) fn multipart(files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut body = Vec::new();
    for (name, bytes) in files {
        let head = format!(
            "--cut\r\nContent-Disposition: form-data; name=\"image\"; filename=\"{name}\"\r\n\r\n"
        );
        body.extend_from_slice(head.as_bytes());
        body.extend_from_slice(bytes);
        body.extend_from_slice(b"\r\n");
    }
    body.extend_from_slice(b"--cut--\r\n");
    body
}

fn parse(answer: &[u8]) -> Answer {
    let end = answer.windows(4).position(|w| w == b"\r\n\r\n").unwrap_or(answer.len());
    let head = String::from_utf8_lossy(&answer[..end]).into_owned();
    let status = head.split(' ').nth(1).and_then(|s| s.parse().ok()).unwrap_or(0);
    let body = answer.get(end + 4..).unwrap_or_default();
    let chunked = head.to_ascii_lowercase().contains("transfer-encoding: chunked");
    let body = if chunked { unchunk(body) } else { body.to_vec() };
    Answer { status, head, body }
}

fn unchunk(mut body: &[u8]) -> Vec<u8> {
    let mut whole = Vec::new();
    while let Some(end) = body.windows(2).position(|w| w == b"\r\n") {
        let len = usize::from_str_radix(std::str::from_utf8(&body[..end]).unwrap(), 16).unwrap();
        if len == 0 {
            break;
        }
        whole.extend_from_slice(&body[end + 2..end + 2 + len]);
        body = &body[end + 4 + len..];
    }
    whole
}
