"""The WebSocket: events of topics, and localization streams."""

from __future__ import annotations

import json
from types import TracebackType
from typing import Any, AsyncGenerator, Optional, Type, Union

from websockets.asyncio.client import connect
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
from .http import AsyncHttp

#: Longest time to open a socket and to have an answer on it, seconds.
OPEN_TIMEOUT = 10.0


class AsyncSocket:
    """One connection to `/v1/ws`."""

    def __init__(self, http: AsyncHttp) -> None:
        self._http = http
        self._opening: Any = None
        self._connection: Any = None

    async def __aenter__(self) -> AsyncSocket:
        url = "ws" + self._http.base[4:] + "/v1/ws"
        try:
            self._opening = connect(
                url,
                additional_headers=self._http.authorization,
                open_timeout=OPEN_TIMEOUT,
                max_size=None,
                proxy=None,
            )
            self._connection = await self._opening.__aenter__()
        except InvalidHandshake as error:
            answer = getattr(error, "response", None)
            if answer is None:
                raise CannotConnect(f"no socket at {url}: {error}") from error
            raise _refused(answer) from error
        except (OSError, TimeoutError) as error:
            hint = "start one with `volery serve`"
            raise CannotConnect(f"no server at {self._http.base}: {error}", hint=hint) from error
        return self

    async def __aexit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        await self.aclose()

    async def aclose(self) -> None:
        """Closes the connection."""
        await self._opening.__aexit__(None, None, None)

    def leave(self) -> None:
        """Drops the connection without a word: also where nothing can be waited for."""
        drop(self._connection)

    async def send(self, message: ClientMessage) -> None:
        """Says something to the server."""
        await self._send(json.dumps(message.to_json(), allow_nan=False))

    async def send_frame(self, header: FrameHeader, payload: bytes) -> None:
        """Sends an image of a stream."""
        await self._send(image_frame(header, payload))

    async def _send(self, data: Union[str, bytes]) -> None:
        try:
            await self._connection.send(data)
        except ConnectionClosed as error:
            raise CannotConnect(f"the socket was closed: {error}") from error

    async def receive(self) -> ServerMessage:
        """What the server says next; an error it names is raised."""
        while True:
            try:
                words = await self._connection.recv()
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


async def topic_messages(
    http: AsyncHttp, topic: str, after: Optional[int] = None
) -> AsyncGenerator[ServerMessage, None]:
    """What is said on a topic, without end."""
    socket = await AsyncSocket(http).__aenter__()
    try:
        await socket.send(SubscribeRequest(topic=topic, after=after))
        while True:
            message = await socket.receive()
            if getattr(message, "topic", topic) == topic:
                yield message
    finally:
        socket.leave()


Answer = Union[FrameResultMessage, FrameTrackedMessage, FrameDroppedMessage]


class AsyncStream:
    """A localization stream: images go in, answers come out.

    ```python
    async with map.stream(camera, track=True) as stream:
        seq = await stream.send(jpeg)
        answer = await stream.receive()
    ```
    """

    def __init__(self, http: AsyncHttp, request: StreamOpenRequest) -> None:
        self._socket = AsyncSocket(http)
        self._request = request
        self._next_seq = 0
        self.opened: Optional[StreamOpenedMessage] = None

    async def __aenter__(self) -> AsyncStream:
        await self._socket.__aenter__()
        try:
            await self._socket.send(self._request)
            while self.opened is None:
                message = await self._socket.receive()
                if isinstance(message, StreamOpenedMessage):
                    self.opened = message
        except BaseException:
            await self._socket.aclose()
            raise
        return self

    async def __aexit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        await self._socket.aclose()

    async def send(
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
        await self._socket.send_frame(header, bytes(image))
        return header.seq

    async def receive(self) -> Answer:
        """The next answer. One frame waits at a time: a newer one takes the place of one that
        waits, which is answered with `FrameDroppedMessage`."""
        while True:
            message = await self._socket.receive()
            if isinstance(message, (FrameResultMessage, FrameTrackedMessage, FrameDroppedMessage)):
                return message


def _refused(answer: Any) -> Exception:
    try:
        value = json.loads(answer.body or b"")
    except ValueError:
        return CannotConnect(f"no socket: HTTP {answer.status_code}")
    error: ServerRefused = refusal(value, answer.status_code)
    return error
