# Written by generate.py; changes here are lost.
"""Jobs: wait, watch, cancel."""

from __future__ import annotations

import time
import warnings
from typing import Any, Iterator, Optional

from .. import types
from ..errors import CannotConnect, JobFailed, Misunderstood, NotFound, Overloaded, TimedOut
from ..progress import Progress, stages_of
from ..types import EventMessage, JobEvent, JobState, ResyncMessage, UploadReport
from .api import Api
from .concurrency import sleep
from .http import Http
from .maps import Map
from .socket import topic_messages

#: States that a job stays in.
FINAL = ("succeeded", "partial", "failed", "cancelled")
#: Between two looks where the socket cannot be had, and how long a server may be away, seconds.
POLL_INTERVAL, MAX_ABSENCE = 0.5, 60.0


class Job:
    """A job of the server."""

    def __init__(self, http: Http, info: types.Job) -> None:
        self._http = http
        self._api = Api(http)
        self.info = info
        """How it stood when it was last looked at."""
        self.upload: Optional[UploadReport] = None
        """What became of the photos that were uploaded for it, file by file."""

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.id} {self.info.kind} {self.state}>"

    @property
    def id(self) -> str:
        """Its id."""
        return self.info.id

    @property
    def state(self) -> JobState:
        """Its state when it was last looked at."""
        return self.info.state

    def refresh(self) -> Job:
        """Looks at it."""
        self.info = self._api.get_job(self.id)
        return self

    def wait(
        self, *, progress: Progress = False, timeout: Optional[float] = None
    ) -> Map:
        """Waits for the end and gives the map that was made.

        * `progress`: `True` for a line on standard error, or a function that takes each `JobEvent`.
        * `timeout`: seconds; without end when absent. The job goes on.

        A `partial` job warns of what its map lacks. One that failed or was cancelled is a
        `JobFailed` with the server's code and hint.
        """
        with stages_of(progress) as tell:
            for event in self.events(timeout=timeout):
                tell(event)
        error = self.info.error
        if self.info.outputs is None:
            detail = error.detail if error else f"the job was {self.state}"
            code, hint = (error.code, error.hint) if error else (self.state, None)
            raise JobFailed(detail, code=code, hint=hint, job=self.info)
        if error is not None:
            warnings.warn(f"the map is not whole: {error.detail} ({error.code})", stacklevel=2)
        return Map(self._http, self._api.get_map(self.info.outputs.map_id))

    def events(
        self, *, after: int = 0, timeout: Optional[float] = None
    ) -> Iterator[JobEvent]:
        """What happened and happens to it, each event once and in order, until it ends.

        By the socket, and by looking where that cannot be had; a server that starts again
        meanwhile is waited for.
        """
        last = after
        contact = time.monotonic()
        deadline = None if timeout is None else contact + timeout
        while True:
            try:
                self.refresh()
                missed = (self._api.job_events(self.id, after=last, limit=1000)).items
                contact = time.monotonic()
            except (CannotConnect, Overloaded):
                if time.monotonic() - contact > MAX_ABSENCE:
                    raise
                missed = ()
            for event in missed:
                last = event.seq
                yield event
            if self.state in FINAL and not missed:
                return
            if deadline is not None and time.monotonic() > deadline:
                raise TimedOut(f"job {self.id} is still {self.state}")
            if missed:
                continue
            if deadline is not None:
                # A socket has no deadline: look now and then.
                sleep(min(POLL_INTERVAL, max(0.0, deadline - time.monotonic())))
                continue
            try:
                for message in topic_messages(self._http, f"job:{self.id}", after=last):
                    if isinstance(message, ResyncMessage):
                        break
                    if isinstance(message, EventMessage) and message.event.seq > last:
                        last = message.event.seq
                        yield message.event
                        if _ends(message.event):
                            break
            except (CannotConnect, Misunderstood, NotFound):
                sleep(POLL_INTERVAL)

    def cancel(self) -> Job:
        """Asks it to stop at its next unit of work."""
        self.info = self._api.cancel_job(self.id)
        return self

    def retry(self, *, from_stage: Optional[str] = None) -> Job:
        """Runs it again; what it has finished is not done again, but for `from_stage` and what
        comes after it."""
        self.info = self._api.retry_job(self.id, from_stage=from_stage)
        return self

    def log(self) -> str:
        """Its log."""
        return self._api.job_log(self.id)

    def report(self) -> Any:
        """Its report, as JSON."""
        return self._api.job_report(self.id)

    def delete(self) -> None:
        """Forgets it. Its map stays."""
        self._api.delete_job(self.id)


def _ends(event: JobEvent) -> bool:
    return (
        event.type == "job.state"
        and isinstance(event.data, dict)
        and event.data.get("state") in FINAL
    )
