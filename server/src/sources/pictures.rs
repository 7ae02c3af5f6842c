//! One connection to a camera: from its address to its pictures.

use std::{
    net::SocketAddr,
    time::{Duration, Instant},
};

use bytes::Bytes;
use http_body_util::{BodyExt, Empty};
use hyper::{Request, Response, body::Incoming, client::conn::http1, header};
use hyper_util::rt::TokioIo;
use tokio::net::TcpStream;
use tokio::time::{Instant as Deadline, timeout, timeout_at};

use super::{
    address::Address,
    failure::Failure,
    hosts::{CameraHost, is_allowed},
    multipart::Multipart,
};
use crate::task::Task;

/// Longest time to the head of the answer.
const ANSWER: Duration = Duration::from_secs(5);
/// Longest time without a byte.
const SILENCE: Duration = Duration::from_secs(5);
/// Longest time without a whole picture.
const PICTURE: Duration = Duration::from_secs(10);
/// Bytes of the answer that are held, of its head at most.
const MAX_BUFFER: usize = 64 << 10;

/// A picture as it came.
#[derive(Debug)]
pub(super) struct Picture {
    pub(super) bytes: Bytes,
    /// By the camera's clock, nanoseconds.
    pub(super) t_capture_ns: Option<u64>,
    /// Its first byte.
    pub(super) arrived: Instant,
}

/// The pictures of an answer.
#[derive(Debug)]
pub(super) struct Pictures {
    body: Incoming,
    multipart: Multipart,
    /// When the first byte of the picture came that is not whole yet.
    began: Option<Instant>,
    /// When the next picture must be whole.
    due: Deadline,
    /// Moves the bytes.
    _connection: Task,
}

impl Pictures {
    /// Asks the camera.
    ///
    /// * `allowed`: where a connection may go to, whatever the name of the host is resolved to.
    /// * `max_bytes`: of a picture.
    pub(super) async fn open(
        address: &Address,
        allowed: &[CameraHost],
        max_bytes: usize,
    ) -> Result<Self, Failure> {
        let (answer, connection) =
            timeout(ANSWER, ask(address, allowed)).await.map_err(|_| {
                let late = format!("no answer in {} s", ANSWER.as_secs());
                Failure::Unreachable(address.authority(), late)
            })??;
        let status = answer.status();
        if status.is_redirection() {
            return Err(Failure::Redirect(status.as_u16()));
        }
        if status.as_u16() != 200 {
            return Err(Failure::Status(status.as_u16()));
        }
        let content_type = answer.headers().get(header::CONTENT_TYPE);
        let content_type = content_type.and_then(|text| text.to_str().ok()).unwrap_or_default();
        let multipart = Multipart::new(content_type, max_bytes)
            .ok_or_else(|| Failure::NotMjpeg(content_type.chars().take(80).collect()))?;
        Ok(Self {
            body: answer.into_body(),
            multipart,
            began: None,
            due: Deadline::now() + PICTURE,
            _connection: connection,
        })
    }

    /// The next picture.
    pub(super) async fn next(&mut self) -> Result<Picture, Failure> {
        loop {
            if let Some(part) = self.multipart.next()? {
                self.due = Deadline::now() + PICTURE;
                let t_capture_ns = part.stamp_s.map(|seconds| (seconds * 1e9) as u64);
                let arrived = self.began.take().unwrap_or_else(Instant::now);
                return Ok(Picture { bytes: part.bytes, t_capture_ns, arrived });
            }
            if self.multipart.has_ended() {
                return Err(Failure::Ended);
            }
            if self.multipart.has_begun() && self.began.is_none() {
                self.began = Some(Instant::now());
            }
            let frame = timeout_at(self.due, timeout(SILENCE, self.body.frame()))
                .await
                .map_err(|_| Failure::TooSlow(PICTURE.as_secs()))?
                .map_err(|_| Failure::Silent(SILENCE.as_secs()))?
                .ok_or(Failure::Ended)?
                .map_err(|error| Failure::Broken(error.to_string()))?;
            if let Some(bytes) = frame.data_ref() {
                self.multipart.push(bytes);
            }
        }
    }
}

/// The head of the answer, and what moves the bytes.
async fn ask(
    address: &Address,
    allowed: &[CameraHost],
) -> Result<(Response<Incoming>, Task), Failure> {
    let broken = |error: &dyn std::fmt::Display| {
        Failure::Unreachable(address.authority(), error.to_string())
    };
    let stream = connect(address, allowed).await?;
    let (mut sender, connection) = http1::Builder::new()
        .max_buf_size(MAX_BUFFER)
        .ignore_invalid_headers_in_responses(true)
        .handshake(TokioIo::new(stream))
        .await
        .map_err(|error| broken(&error))?;
    let connection = Task(tokio::spawn(async move {
        // Whoever reads the body sees that it breaks off.
        let _ = connection.await;
    }));
    let request = Request::get(&address.path)
        .header(header::HOST, address.authority())
        .header(header::ACCEPT, "multipart/x-mixed-replace")
        .header(header::CONNECTION, "close")
        .body(Empty::<Bytes>::new())
        .map_err(|error| broken(&error))?;
    let answer = sender.send_request(request).await.map_err(|error| broken(&error))?;
    Ok((answer, connection))
}

/// Connects to the host's first address that may be connected to and answers: to that one, and not
/// to what the name may mean later.
async fn connect(address: &Address, allowed: &[CameraHost]) -> Result<TcpStream, Failure> {
    let Address { host, port, .. } = address;
    let unreachable =
        |error: std::io::Error| Failure::Unreachable(address.authority(), error.to_string());
    let resolved = tokio::net::lookup_host((host.as_str(), *port)).await.map_err(unreachable)?;
    let usable: Vec<SocketAddr> =
        resolved.filter(|resolved| is_allowed(allowed, host, *resolved)).collect();
    let mut failure = Failure::HostRefused(address.authority());
    for one in usable {
        match TcpStream::connect(one).await {
            Ok(stream) => return Ok(stream),
            Err(error) => failure = unreachable(error),
        }
    }
    Err(failure)
}
