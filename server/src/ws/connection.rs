//! One open socket.

use std::{
    collections::HashMap,
    sync::Arc,
    time::{Duration, Instant},
};

use axum::extract::ws::{CloseFrame, Message, WebSocket, close_code};
use futures_util::{SinkExt, StreamExt, stream::SplitSink};
use tokio::sync::mpsc;
use uuid::Uuid;
use volery_api::ws::{
    ClientBody, ClientMessage, FRAME_IMAGE_QUERY, FrameHeader, ServerBody, ServerMessage,
    split_frame,
};

use super::{leases::Leases, topics};
use crate::{
    auth::Caller,
    clock,
    error::ApiResult,
    extract::parse_json,
    metrics::{add, sub},
    state::App,
    streams::{Gone, Listener, Stream, permit},
    task::Task,
};

/// Messages that may wait for a slow client before it is shut out.
const QUEUE: usize = 64;
const PING: Duration = Duration::from_secs(10);
/// Close code for a token that has ended.
const UNAUTHORIZED: u16 = 4401;
/// Time without a sign of life after which a client is gone.
const SILENCE: Duration = Duration::from_secs(30);
const MAX_TOPICS: usize = 256;
const MAX_STREAMS: usize = 16;

/// Sends messages of the server; fails when the client is too slow or gone.
#[derive(Debug, Clone)]
pub(super) struct Outbox(mpsc::Sender<ServerMessage>);

impl Outbox {
    pub(super) fn send(&self, re: Option<String>, body: ServerBody) -> Result<(), Gone> {
        let message = ServerMessage { re, t_ns: clock::now_ns(), body };
        self.0.try_send(message).map_err(|_| Gone)
    }

    /// Until half of the queue is free.
    pub(super) async fn wait(&self) -> Result<(), Gone> {
        self.0.reserve_many(QUEUE / 2).await.map(drop).map_err(|_| Gone)
    }
}

/// The connection finds its outbox full at its next message.
impl Listener for Outbox {
    fn tell(&self, body: ServerBody) -> Result<(), Gone> {
        self.send(None, body)
    }
}

/// Serves a socket until either side ends it.
pub(super) async fn run(app: Arc<App>, caller: Caller, socket: WebSocket, max_frame_bytes: u64) {
    add(&app.metrics.sockets, 1);
    let (mut sink, mut stream) = socket.split();
    let (sender, mut outbox) = mpsc::channel(QUEUE);
    let mut connection = Connection {
        app: Arc::clone(&app),
        caller: caller.clone(),
        outbox: Outbox(sender),
        topics: HashMap::new(),
        streams: HashMap::new(),
        leases: Leases::new(&app, &caller),
        next_stream: 1,
    };
    let hello = ServerBody::Hello {
        version: env!("CARGO_PKG_VERSION").to_owned(),
        conn_id: Uuid::now_v7(),
        ping_s: PING.as_secs(),
        max_frame_bytes,
    };
    let mut result = connection.outbox.send(None, hello);
    let mut ping = tokio::time::interval(PING);
    let mut last_heard = tokio::time::Instant::now();
    let reason = loop {
        if result.is_err() || connection.is_stuck() {
            break (close_code::AGAIN, "the client reads too slowly");
        }
        tokio::select! {
            message = outbox.recv() => {
                let Some(message) = message else { break (close_code::ERROR, "defect") };
                if write(&mut sink, &message).await.is_err() {
                    break (close_code::ABNORMAL, "gone");
                }
            }
            received = stream.next() => {
                last_heard = tokio::time::Instant::now();
                result = match received {
                    Some(Ok(Message::Text(text))) => connection.text(text.as_bytes()).await,
                    Some(Ok(Message::Binary(frame))) => connection.frame(frame),
                    Some(Ok(Message::Ping(_) | Message::Pong(_))) => Ok(()),
                    Some(Ok(Message::Close(_))) | None => break (close_code::NORMAL, ""),
                    Some(Err(error)) => {
                        tracing::debug!(%error, "socket ended");
                        break (close_code::SIZE, "the message cannot be read");
                    }
                };
            }
            now = ping.tick() => {
                if !may_stay(&app, &caller).await {
                    break (UNAUTHORIZED, "the token is not valid any more");
                }
                if now.duration_since(last_heard) > SILENCE {
                    break (close_code::AWAY, "no sign of life");
                }
                if sink.send(Message::Ping(Default::default())).await.is_err() {
                    break (close_code::ABNORMAL, "gone");
                }
            }
            () = app.closing.cancelled() => break (close_code::RESTART, "the service closes down"),
        }
    };
    let (code, text) = reason;
    if code != close_code::ABNORMAL {
        let frame = CloseFrame { code, reason: text.into() };
        let close = sink.send(Message::Close(Some(frame)));
        // A client that does not read cannot be told.
        let _ = tokio::time::timeout(Duration::from_secs(1), close).await;
    }
    sub(&app.metrics.sockets, 1);
}

/// A token may end while its socket is open.
async fn may_stay(app: &App, caller: &Caller) -> bool {
    // A database that is busy is no reason to throw a client out.
    caller.id.is_nil() || app.store.token_lives(caller.id).await.unwrap_or(true)
}

async fn write(
    sink: &mut SplitSink<WebSocket, Message>,
    message: &ServerMessage,
) -> Result<(), Gone> {
    let text = serde_json::to_string(message).map_err(|_| Gone)?;
    let send = sink.send(Message::Text(text.into()));
    match tokio::time::timeout(SILENCE, send).await {
        Ok(Ok(())) => Ok(()),
        _ => Err(Gone),
    }
}

struct Connection {
    app: Arc<App>,
    caller: Caller,
    outbox: Outbox,
    topics: HashMap<String, Task>,
    streams: HashMap<u32, Stream>,
    leases: Leases,
    next_stream: u32,
}

impl Connection {
    /// Whether a task of this connection could not send.
    fn is_stuck(&self) -> bool {
        self.topics.values().any(|task| task.0.is_finished())
    }

    async fn text(&mut self, text: &[u8]) -> Result<(), Gone> {
        match parse_json::<ClientMessage>(text) {
            Err(error) => {
                let body = ServerBody::Error {
                    code: error.code().to_owned(),
                    detail: error.detail.clone(),
                };
                self.outbox.send(None, body)
            }
            Ok(ClientMessage { id, body }) => {
                let answer = self.answer(body).await.unwrap_or_else(|error| ServerBody::Error {
                    code: error.code().to_owned(),
                    detail: error.detail.clone(),
                });
                self.outbox.send(id, answer)
            }
        }
    }

    async fn answer(&mut self, body: ClientBody) -> ApiResult<ServerBody> {
        Ok(match body {
            ClientBody::Ping {} => ServerBody::Pong {},
            ClientBody::Subscribe { topic, after } => {
                if self.topics.len() >= MAX_TOPICS && !self.topics.contains_key(&topic) {
                    return Ok(too_many("topics", MAX_TOPICS));
                }
                let task = topics::subscribe(&self.app, self.outbox.clone(), &topic, after).await?;
                self.topics.insert(topic.clone(), task);
                ServerBody::Subscribed { topic }
            }
            ClientBody::Unsubscribe { topic } => {
                self.topics.remove(&topic);
                ServerBody::Unsubscribed { topic }
            }
            ClientBody::StreamOpen(open) => {
                if self.streams.len() >= MAX_STREAMS {
                    return Ok(too_many("streams", MAX_STREAMS));
                }
                let stream_id = self.next_stream;
                let permitted = permit(&self.app, self.caller.role, open).await?;
                let stream = Stream::start(&self.app, permitted, Box::new(self.outbox.clone()));
                let opened = stream.opened(stream_id);
                self.next_stream += 1;
                self.streams.insert(stream_id, stream);
                opened
            }
            ClientBody::StreamClose { stream_id } => {
                self.streams.remove(&stream_id);
                ServerBody::StreamClosed { stream_id }
            }
            ClientBody::Lease(request) => self.leases.take(&request)?,
            ClientBody::LeaseRenew { lease_id } => self.leases.renew(lease_id)?,
            ClientBody::LeaseRelease { lease_id } => self.leases.release(lease_id)?,
        })
    }

    fn frame(&mut self, frame: bytes::Bytes) -> Result<(), Gone> {
        let bad = |detail: &str| ServerBody::Error {
            code: "bad_frame".to_owned(),
            detail: detail.to_owned(),
        };
        let Some((kind, header, payload)) = split_frame(&frame) else {
            return self.outbox.send(None, bad("the prefix makes no sense"));
        };
        if kind != FRAME_IMAGE_QUERY {
            return self.outbox.send(None, bad("the kind is unknown"));
        }
        let header: FrameHeader = match parse_json(header) {
            Ok(header) => header,
            Err(error) => return self.outbox.send(None, bad(&error.detail)),
        };
        match self.streams.get(&header.stream_id) {
            None => self.outbox.send(None, bad("the stream is not open")),
            Some(stream) => stream.push(header, frame.slice_ref(payload), Instant::now()),
        }
    }
}

fn too_many(what: &str, max: usize) -> ServerBody {
    ServerBody::Error {
        code: "too_many".to_owned(),
        detail: format!("a connection has at most {max} {what}"),
    }
}
