"""Requests with token, retries, and problems as errors."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, Callable, Dict, Mapping, Optional, TypeVar
from urllib.parse import urlsplit

import httpx

from ..errors import CannotConnect, Misunderstood, NotFound, Overloaded, TimedOut, refusal
from ..wire import plain
from .concurrency import sleep

T = TypeVar("T")

#: Waits before the second, third, ... try of a request that may be repeated, seconds.
RETRY_WAITS = (0.1, 0.4, 1.5, 4.0)
#: Longest time to open a connection and to wait for the next bytes, seconds.
CONNECT_TIMEOUT, READ_TIMEOUT = 5.0, 120.0


class AsyncHttp:
    """A server and a token."""

    def __init__(
        self, server: Optional[str], token: Optional[str], timeout: float = READ_TIMEOUT
    ) -> None:
        server = server or os.environ.get("VOLERY_SERVER") or "http://127.0.0.1:8420"
        if urlsplit(server).scheme not in ("http", "https") or not urlsplit(server).hostname:
            raise ValueError(f"server {server!r}: expected http://HOST:PORT")
        self.base = server.rstrip("/")
        self.token = token or os.environ.get("VOLERY_TOKEN")
        self.authorization = {"Authorization": f"Bearer {self.token}"} if self.token else {}
        # A ground station is next door: no proxy stands between.
        self._client = httpx.AsyncClient(
            base_url=self.base,
            headers=self.authorization,
            timeout=httpx.Timeout(timeout, connect=CONNECT_TIMEOUT),
            follow_redirects=True,
            trust_env=False,
        )

    async def aclose(self) -> None:
        """Closes all connections."""
        await self._client.aclose()

    async def call(
        self,
        method: str,
        path: str,
        read: Callable[[httpx.Response], T],
        *,
        body: Any = None,
        files: Any = None,
        query: Optional[Mapping[str, Any]] = None,
        headers: Optional[Mapping[str, Any]] = None,
        key: Optional[str] = None,
        repeatable: Optional[bool] = None,
    ) -> T:
        """Sends a request and reads the answer.

        A request that does no more when it arrives twice is repeated while the trouble may pass:
        GET, PUT, PATCH, DELETE and those with an `Idempotency-Key`, unless `repeatable` says
        otherwise.
        """
        request: Dict[str, Any] = {
            "params": {name: value for name, value in (query or {}).items() if value is not None},
            "headers": {
                name: value if isinstance(value, bytes) else str(value).encode()
                for name, value in (headers or {}).items()
                if value is not None
            },
        }
        if key is not None:
            request["headers"]["Idempotency-Key"] = key.encode()
        if files is not None:
            request["files"] = files
        elif isinstance(body, bytes):
            request["content"] = body
        elif isinstance(body, str):
            request["content"] = body.encode()
            request["headers"]["Content-Type"] = b"text/csv"
        elif body is not None:
            request["content"] = json.dumps(plain(body), allow_nan=False).encode()
            request["headers"]["Content-Type"] = b"application/json"
        may_repeat = repeatable
        if may_repeat is None:
            may_repeat = key is not None or method != "POST"
        waits = list(RETRY_WAITS) if may_repeat else []
        tries = 0
        while True:
            tries += 1
            try:
                return read(await self._send(method, path, request))
            except NotFound:
                # It was gone before this try, by one that had no answer.
                if method == "DELETE" and tries > 1:
                    return read(httpx.Response(204))
                raise
            except (CannotConnect, Overloaded) as error:
                if not waits:
                    raise
                await sleep(max(waits.pop(0), getattr(error, "retry_after", 0.0)))

    async def download(self, path: str, query: Mapping[str, Any], target: Path) -> Path:
        """Writes the body of an answer to a file that appears when it is whole. A connection that
        breaks is taken up where it broke."""
        part = target.with_name(target.name + ".part")
        waits = list(RETRY_WAITS)
        etag: Optional[str] = None
        with part.open("wb") as file:
            while True:
                have = file.tell()
                headers = {"Range": f"bytes={have}-", "If-Range": etag} if have and etag else {}
                request = self._client.build_request(
                    "GET", path, params=dict(query), headers=headers
                )
                try:
                    answer = await self._answered(request, stream=True)
                    etag = answer.headers.get("etag")
                    if answer.status_code != 206:
                        file.seek(0)
                        file.truncate()
                    try:
                        async for chunk in answer.aiter_bytes():
                            file.write(chunk)
                    except httpx.TransportError as error:
                        raise CannotConnect(f"{path} broke off: {error}") from error
                    finally:
                        await answer.aclose()
                    break
                except CannotConnect:
                    if not waits:
                        raise
                    await sleep(waits.pop(0))
        part.replace(target)
        return target

    async def _send(self, method: str, path: str, request: Dict[str, Any]) -> httpx.Response:
        return await self._answered(
            self._client.build_request(method, path, **request), stream=False
        )

    async def _answered(self, request: httpx.Request, stream: bool) -> httpx.Response:
        try:
            answer = await self._client.send(request, stream=stream)
            if answer.status_code >= 400 and stream:
                await answer.aread()
        except httpx.ConnectError as error:
            raise CannotConnect(
                f"no server at {self.base}: {error}", hint="start one with `volery serve`"
            ) from error
        except (httpx.ReadTimeout, httpx.WriteTimeout, httpx.PoolTimeout) as error:
            raise TimedOut(f"{request.method} {request.url} took too long") from error
        except httpx.TransportError as error:
            what = f"{type(error).__name__}: {error}"
            raise CannotConnect(f"the connection to {self.base} broke: {what}") from error
        if answer.status_code < 400:
            return answer
        raise problem(answer)


def problem(answer: httpx.Response) -> Exception:
    """The error for an answer that is none."""
    is_problem = answer.headers.get("content-type", "").startswith("application/problem+json")
    try:
        value = answer.json() if is_problem else None
    except ValueError:
        value = None
    if not isinstance(value, dict):
        return Misunderstood(f"HTTP {answer.status_code}: {answer.text[:200]}")
    error = refusal(value, answer.status_code)
    error.retry_after = _seconds(answer.headers.get("retry-after"))
    return error


def _seconds(words: Optional[str]) -> float:
    return float(words) if words is not None and words.isdigit() else 0.0
