//! The WebSocket: events of jobs, and localization streams.

use futures_util::{SinkExt, StreamExt};
use tokio::net::TcpStream;
use tokio_tungstenite::{
    MaybeTlsStream, WebSocketStream, connect_async,
    tungstenite::{Message, client::IntoClientRequest, http::HeaderValue},
};
use uuid::Uuid;
use volery_api::{
    JobEvent, JobState, LocalizeAnswer, TrackedFrame,
    ws::{
        ClientBody, ClientMessage, FRAME_IMAGE_QUERY, FrameHeader, ServerBody, ServerMessage,
        StreamOpen, join_frame,
    },
};

use crate::{Client, ClientError};

type Socket = WebSocketStream<MaybeTlsStream<TcpStream>>;

/// A localization stream: frames go in, answers come out, the newest frame wins.
pub struct LocalizationStream {
    socket: Socket,
    stream_id: u32,
    next_seq: u64,
}

/// What came of a frame.
#[derive(Debug, Clone, PartialEq)]
pub enum StreamAnswer {
    /// The answer to frame `seq`.
    Result {
        /// Number of the frame.
        seq: u64,
        /// As REST answers it.
        answer: Box<LocalizeAnswer>,
    },
    /// The answer to frame `seq` of a stream that tracks.
    Tracked {
        /// Number of the frame.
        seq: u64,
        /// Of the frame.
        t_capture_ns: Option<u64>,
        /// State, pose and latency.
        frame: Box<TrackedFrame>,
    },
    /// Frame `seq` has no answer.
    Dropped {
        /// Number of the frame.
        seq: u64,
        /// `superseded`, `too_large`, `decode_error`, `overload`.
        reason: String,
    },
}

impl Client {
    async fn open_socket(&self) -> Result<Socket, ClientError> {
        let url = self.base.replacen("http://", "ws://", 1) + "/v1/ws";
        let mut request = url.into_client_request().map_err(transport)?;
        if let Some(token) = &self.token {
            let value = HeaderValue::from_str(&format!("Bearer {token}"))
                .map_err(|e| ClientError::BadArgument(e.to_string()))?;
            request.headers_mut().insert("Authorization", value);
        }
        let (socket, _) = connect_async(request).await.map_err(transport)?;
        Ok(socket)
    }

    /// Hands over events of a job until it ends (`Ok`) or the socket does.
    pub(crate) async fn follow_events(
        &self,
        job: Uuid,
        last: &mut u64,
        each: &mut impl FnMut(&JobEvent),
    ) -> Result<(), ClientError> {
        let mut socket = self.open_socket().await?;
        let subscribe = ClientBody::Subscribe { topic: format!("job:{job}"), after: Some(*last) };
        send(&mut socket, subscribe).await?;
        loop {
            match receive(&mut socket).await? {
                ServerBody::Event { event, .. } if event.seq > *last => {
                    *last = event.seq;
                    each(&event);
                    let state = event.data["state"].as_str().and_then(JobState::from_name);
                    if event.kind == "job.state" && state.is_some_and(JobState::is_final) {
                        return Ok(());
                    }
                }
                ServerBody::Resync { .. } => return Ok(()),
                ServerBody::Error { code, detail } => {
                    return Err(ClientError::Protocol(format!("{code}: {detail}")));
                }
                _ => {}
            }
        }
    }

    /// Opens a localization stream.
    pub async fn open_stream(&self, open: StreamOpen) -> Result<LocalizationStream, ClientError> {
        let mut socket = self.open_socket().await?;
        send(&mut socket, ClientBody::StreamOpen(open)).await?;
        loop {
            match receive(&mut socket).await? {
                ServerBody::StreamOpened { stream_id, .. } => {
                    return Ok(LocalizationStream { socket, stream_id, next_seq: 0 });
                }
                ServerBody::Error { code, detail } => {
                    return Err(ClientError::Protocol(format!("{code}: {detail}")));
                }
                _ => {}
            }
        }
    }
}

impl LocalizationStream {
    /// Sends an encoded image; returns its number.
    pub async fn send(&mut self, image: &[u8]) -> Result<u64, ClientError> {
        let seq = self.next_seq;
        self.next_seq += 1;
        let header = FrameHeader {
            stream_id: self.stream_id,
            seq,
            t_capture_ns: None,
            encoding: Default::default(),
            width: None,
            height: None,
            prior: None,
            telemetry: None,
        };
        self.send_frame(&header, image).await?;
        Ok(seq)
    }

    /// Sends an image with a header of the caller's; `stream_id` is set here.
    pub async fn send_frame(
        &mut self,
        header: &FrameHeader,
        image: &[u8],
    ) -> Result<(), ClientError> {
        let header = FrameHeader { stream_id: self.stream_id, ..header.clone() };
        let header =
            serde_json::to_vec(&header).map_err(|e| ClientError::BadArgument(e.to_string()))?;
        let frame = join_frame(FRAME_IMAGE_QUERY, &header, image);
        self.socket.send(Message::Binary(frame.into())).await.map_err(transport)
    }

    /// The next answer.
    pub async fn next(&mut self) -> Result<StreamAnswer, ClientError> {
        loop {
            match receive(&mut self.socket).await? {
                ServerBody::FrameResult { seq, result, .. } => {
                    return Ok(StreamAnswer::Result { seq, answer: result });
                }
                ServerBody::FrameTracked { seq, t_capture_ns, result, .. } => {
                    return Ok(StreamAnswer::Tracked { seq, t_capture_ns, frame: result });
                }
                ServerBody::FrameDropped { seq, reason, .. } => {
                    return Ok(StreamAnswer::Dropped { seq, reason });
                }
                ServerBody::Error { code, detail } => {
                    return Err(ClientError::Protocol(format!("{code}: {detail}")));
                }
                _ => {}
            }
        }
    }
}

async fn send(socket: &mut Socket, body: ClientBody) -> Result<(), ClientError> {
    let text = serde_json::to_string(&ClientMessage { id: None, body })
        .map_err(|e| ClientError::BadArgument(e.to_string()))?;
    socket.send(Message::Text(text.into())).await.map_err(transport)
}

async fn receive(socket: &mut Socket) -> Result<ServerBody, ClientError> {
    loop {
        match socket.next().await {
            Some(Ok(Message::Text(text))) => {
                let message: ServerMessage = serde_json::from_str(&text)
                    .map_err(|e| ClientError::Protocol(e.to_string()))?;
                return Ok(message.body);
            }
            Some(Ok(Message::Close(_))) | None => {
                return Err(ClientError::Transport("the socket was closed".to_owned()));
            }
            Some(Ok(_)) => {}
            Some(Err(error)) => return Err(transport(error)),
        }
    }
}

fn transport(error: tokio_tungstenite::tungstenite::Error) -> ClientError {
    ClientError::Transport(error.to_string())
}
