"""What is done at the same time: threads here, tasks in `_async`."""

from __future__ import annotations

import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Callable, Iterator, Optional, Sequence, TypeVar

A = TypeVar("A")
R = TypeVar("R")


def sleep(seconds: float) -> None:
    """Waits."""
    time.sleep(seconds)


def in_order(do: Callable[[A], R], items: Sequence[A], at_once: int) -> Iterator[R]:
    """Does something to all items, some at a time; results are in the order of the items."""
    with ThreadPoolExecutor(at_once) as pool:
        running = [pool.submit(do, item) for item in items[:at_once]]
        waiting = list(items[at_once:])
        try:
            while running:
                result = running.pop(0).result()
                if waiting:
                    running.append(pool.submit(do, waiting.pop(0)))
                yield result
        finally:
            for future in running:
                future.cancel()


def drop(connection: Any) -> None:
    """Ends a connection of websockets."""
    connection.close()


class Repeater:
    """Does something again and again in the background until it is closed or fails."""

    def __init__(self, do: Callable[[], None], every: float) -> None:
        self._do = do
        self._every = every
        self.error: Optional[BaseException] = None
        self._ended = threading.Event()
        # A daemon does not keep a script alive that has come to its end.
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            while not self._ended.wait(self._every):
                self._do()
        except Exception as error:
            self.error = error

    def close(self) -> None:
        """Ends it."""
        self._ended.set()
        self._thread.join()
