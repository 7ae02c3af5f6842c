# Written by generate.py; changes here are lost.
"""The WebSocket: events of topics, and localization streams."""

from __future__ import annotations

import json
from types import TracebackType
from typing import Any, Generator, Optional, Type, Union

from websockets.sync.client import connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake

from ..errors import CannotConnect, Misunderstood, ServerRefused, TimedOut, refusal
from ..types import (
    ClientMessage,
    ErrorMessage,
    FrameDroppedMessage,
    FrameHeader,
    FrameResultMessage,
    FrameTelemetry,
    FrameTrackedMessage,
    ImageEncoding,
    LocalizePrior,
    ServerMessage,
    StreamOpenedMessage,
    StreamOpenRequest,
    SubscribeRequest,
)
from ..wire import image_frame, understood
from .concurrency import drop
from .http import Http

#: Longest time to open a socket and to have an answer on it, seconds.
OPEN_TIMEOUT = 10.0


class Socket:
    """One connection to `/v1/ws`."""

    def __init__(self, http: Http) -> None:
        self._http = http
        self._opening: Any = None
        self._connection: Any = None

    def __enter__(self) -> Socket:
        url = "ws" + self._http.base[4:] + "/v1/ws"
        try:
            self._opening = connect(
                url,
                additional_headers=self._http.authorization,
                open_timeout=OPEN_TIMEOUT,
                max_size=None,
                proxy=None,
            )
            self._connection = self._opening.__enter__()
        except InvalidHandshake as error:
            answer = getattr(error, "response", None)
            if answer is None:
                raise CannotConnect(f"no socket at {url}: {error}") from error
            raise _refused(answer) from error
        except (OSError, TimeoutError) as error:
            hint = "start one with `volery serve`"
            raise CannotConnect(f"no server at {self._http.base}: {error}", hint=hint) from error
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self.close()

    def close(self) -> None:
        """Closes the connection."""
        self._opening.__exit__(None, None, None)

    def leave(self) -> None:
        """Drops the connection without a word: also where nothing can be waited for."""
        drop(self._connection)

    def send(self, message: ClientMessage) -> None:
        """Says something to the server."""
        self._send(json.dumps(message.to_json(), allow_nan=False))

    def send_frame(self, header: FrameHeader, payload: bytes) -> None:
        """Sends an image of a stream."""
        self._send(image_frame(header, payload))

    def _send(self, data: Union[str, bytes]) -> None:
        try:
            self._connection.send(data)
        except ConnectionClosed as error:
            raise CannotConnect(f"the socket was closed: {error}") from error

    def receive(self) -> ServerMessage:
        """What the server says next; an error it names is raised."""
        while True:
            try:
                words = self._connection.recv()
            except ConnectionClosed as error:
                raise CannotConnect(f"the socket was closed: {error}") from error
            except TimeoutError as error:
                raise TimedOut("the server said nothing") from error
            if not isinstance(words, str):
                continue
            try:
                message: ServerMessage = understood(ServerMessage, json.loads(words))
            except Misunderstood:
                # A newer server may say more than this package knows.
                continue
            if isinstance(message, ErrorMessage):
                raise refusal({"code": message.code, "detail": message.detail}, 422)
            return message


def topic_messages(
    http: Http, topic: str, after: Optional[int] = None
) -> Generator[ServerMessage, None, None]:
    """What is said on a topic, without end."""
    socket = Socket(http).__enter__()
    try:
        socket.send(SubscribeRequest(topic=topic, after=after))
        while True:
            message = socket.receive()
            if getattr(message, "topic", topic) == topic:
                yield message
    finally:
        socket.leave()


Answer = Union[FrameResultMessage, FrameTrackedMessage, FrameDroppedMessage]


class Stream:
    """A localization stream: images go in, answers come out.

    ```python
    with map.stream(camera, track=True) as stream:
        seq = stream.send(jpeg)
        answer = stream.receive()
    ```
    """

    def __init__(self, http: Http, request: StreamOpenRequest) -> None:
        self._socket = Socket(http)
        self._request = request
        self._next_seq = 0
        self.opened: Optional[StreamOpenedMessage] = None

    def __enter__(self) -> Stream:
        self._socket.__enter__()
        try:
            self._socket.send(self._request)
            while self.opened is None:
                message = self._socket.receive()
                if isinstance(message, StreamOpenedMessage):
                    self.opened = message
        except BaseException:
            self._socket.close()
            raise
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self._socket.close()

    def send(
        self,
        image: Any,
        *,
        t_capture_ns: Optional[int] = None,
        prior: Optional[LocalizePrior] = None,
        telemetry: Optional[FrameTelemetry] = None,
    ) -> int:
        """Sends an image and returns its number.

        * `image`: bytes of a JPEG or PNG, or an array of uint8, height x width (gray) or
          height x width x 3 (RGB).
        * `t_capture_ns`: when it was taken; rising in a stream that tracks.
        * `prior`: what is known of its pose, in the map; for streams that do not track.
        * `telemetry`: what the drone reports of itself; for streams that track.
        """
        if self.opened is None:
            raise ValueError("a stream is used inside of its `with` block")
        encoding: Optional[ImageEncoding] = None
        width = height = None
        if not isinstance(image, (bytes, bytearray, memoryview)):
            encoding = "gray8" if image.ndim == 2 else "rgb8"
            height, width = image.shape[:2]
            image = image.tobytes()
        header = FrameHeader(
            stream_id=self.opened.stream_id,
            seq=self._next_seq,
            t_capture_ns=t_capture_ns,
            encoding=encoding,
            width=width,
            height=height,
            prior=prior,
            telemetry=telemetry,
        )
        self._next_seq += 1
        self._socket.send_frame(header, bytes(image))
        return header.seq

    def receive(self) -> Answer:
        """The next answer. One frame waits at a time: a newer one takes the place of one that
        waits, which is answered with `FrameDroppedMessage`."""
        while True:
            message = self._socket.receive()
            if isinstance(message, (FrameResultMessage, FrameTrackedMessage, FrameDroppedMessage)):
                return message


def _refused(answer: Any) -> Exception:
    try:
        value = json.loads(answer.body or b"")
    except ValueError:
        return CannotConnect(f"no socket: HTTP {answer.status_code}")
    error: ServerRefused = refusal(value, answer.status_code)
    return error
