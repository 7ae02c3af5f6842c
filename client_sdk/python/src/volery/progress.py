"""How far something is, for people."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import Any, Callable, Iterator, Union

Tell = Callable[..., None]
Progress = Union[bool, Tell]


class _Line:
    """A line on standard error that is written over while it is a terminal's."""

    def __init__(self) -> None:
        self._is_terminal = sys.stderr.isatty()
        self._last = ""

    def write(self, words: str) -> None:
        if words == self._last:
            return
        if self._is_terminal:
            sys.stderr.write("\r" + words.ljust(len(self._last)))
        else:
            sys.stderr.write(words + "\n")
        self._last = words
        sys.stderr.flush()

    def end(self) -> None:
        if self._is_terminal and self._last:
            sys.stderr.write("\n")


@contextmanager
def progress_of(progress: Progress, what: str, total: int) -> Iterator[Tell]:
    """A function that is told how many are done and what came of the latest."""
    if callable(progress):
        tell = progress
        yield lambda done, latest: tell(done, total, latest)
        return
    line = _Line() if progress else None

    def count(done: int, latest: Any) -> None:
        if line is not None:
            line.write(f"{what}: {done} of {total}")

    yield count
    if line is not None:
        line.end()


@contextmanager
def stages_of(progress: Progress) -> Iterator[Tell]:
    """A function that is told each event of a job."""
    if callable(progress):
        yield progress
        return
    line = _Line() if progress else None

    def event(event: Any) -> None:
        data = event.data if isinstance(event.data, dict) else {}
        if line is None or event.type not in ("job.stage", "job.progress", "job.state"):
            return
        if event.type == "job.state":
            line.write(f"job {data.get('state')}")
            return
        left = data.get("eta_s")
        share = f"{100 * float(data.get('fraction') or 0):3.0f} %"
        line.write(f"{share} {data.get('stage')}" + (f", {left:.0f} s left" if left else ""))

    yield event
    if line is not None:
        line.end()
