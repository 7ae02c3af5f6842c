"""What is done at the same time: tasks here, threads in `_sync`."""

from __future__ import annotations

import asyncio
from typing import Any, AsyncIterator, Awaitable, Callable, Optional, Sequence, TypeVar

A = TypeVar("A")
R = TypeVar("R")


async def sleep(seconds: float) -> None:
    """Waits."""
    await asyncio.sleep(seconds)


async def in_order(
    do: Callable[[A], Awaitable[R]], items: Sequence[A], at_once: int
) -> AsyncIterator[R]:
    """Does something to all items, some at a time; results are in the order of the items."""
    running = [asyncio.ensure_future(do(item)) for item in items[:at_once]]
    waiting = list(items[at_once:])
    try:
        while running:
            result = await running.pop(0)
            if waiting:
                running.append(asyncio.ensure_future(do(waiting.pop(0))))
            yield result
    finally:
        for task in running:
            task.cancel()


def drop(connection: Any) -> None:
    """Ends a connection of websockets."""
    connection.transport.abort()


class AsyncRepeater:
    """Does something again and again in the background until it is closed or fails."""

    def __init__(self, do: Callable[[], Awaitable[None]], every: float) -> None:
        self._do = do
        self._every = every
        self.error: Optional[BaseException] = None
        self._task = asyncio.ensure_future(self._run())

    async def _run(self) -> None:
        try:
            while True:
                await asyncio.sleep(self._every)
                await self._do()
        except Exception as error:
            self.error = error

    async def aclose(self) -> None:
        """Ends it."""
        self._task.cancel()
        await asyncio.wait([self._task])
