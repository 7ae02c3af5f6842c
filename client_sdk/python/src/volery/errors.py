"""What can go wrong, each with a stable `code` and, where there is one, a `hint` what to do."""

from __future__ import annotations

from typing import Any, Optional, Sequence


class VoleryError(Exception):
    """All errors of this package.

    `code` is stable and for programs, `hint` says what to do.
    """

    def __init__(self, detail: str, *, code: str, hint: Optional[str] = None) -> None:
        super().__init__(f"{detail} ({code})" + (f"; {hint}" if hint else ""))
        self.detail = detail
        self.code = code
        self.hint = hint


class ServerRefused(VoleryError):
    """The server answered with a problem (`application/problem+json`)."""

    def __init__(self, problem: Any, status: int) -> None:
        super().__init__(
            str(problem.get("detail") or problem.get("title") or "refused"),
            code=str(problem.get("code", "unknown")),
            hint=problem.get("hint"),
        )
        self.status = status
        self.title = str(problem.get("title", ""))
        self.instance: Optional[str] = problem.get("instance")
        self.problem: Any = problem
        self.retry_after = 0.0
        """Seconds that the server asks to wait."""


class Unauthorized(ServerRefused):
    """There is no token, or it is not known (401)."""


class Forbidden(ServerRefused):
    """The token's role does not allow this (403)."""


class NotFound(ServerRefused):
    """There is no such thing (404)."""


class Conflict(ServerRefused):
    """Not in this state (409)."""


class Invalid(ServerRefused):
    """The request makes no sense to the server (400, 413, 415, 422)."""


class Overloaded(ServerRefused):
    """The server has too much to do (429, 503); it was tried again in vain."""


class ServerFailed(ServerRefused):
    """The server made a mistake (5xx)."""


class CannotConnect(VoleryError):
    """The server cannot be reached, or the connection broke."""

    def __init__(self, detail: str, *, hint: Optional[str] = None) -> None:
        super().__init__(detail, code="unreachable", hint=hint)


class TimedOut(VoleryError):
    """Something took longer than allowed."""

    def __init__(self, detail: str) -> None:
        super().__init__(detail, code="timed_out")


class Misunderstood(VoleryError):
    """The server said something that this package does not understand."""

    def __init__(self, detail: str) -> None:
        super().__init__(detail, code="protocol", hint="are client and server of one version?")


class JobFailed(VoleryError):
    """A job ended without a result; `job` is how it stood."""

    def __init__(self, detail: str, *, code: str, hint: Optional[str], job: Any) -> None:
        super().__init__(detail, code=code, hint=hint)
        self.job = job


class UploadRejected(VoleryError):
    """No photo of an upload was taken; `results` says why, photo by photo."""

    def __init__(self, detail: str, *, results: Sequence[Any]) -> None:
        super().__init__(detail, code="no_photos")
        self.results = results


class CommandFailed(VoleryError):
    """A drone did not do what it was told; `status` is how far the command came."""

    def __init__(self, detail: str, *, code: str, status: Any) -> None:
        super().__init__(detail, code=code)
        self.status = status


class FlightAborted(VoleryError):
    """A flight ended before its goals; `flight` is how it stood."""

    def __init__(self, detail: str, *, flight: Any) -> None:
        super().__init__(detail, code="flight_aborted")
        self.flight = flight


class LeaseLost(VoleryError):
    """The lease of drones has ended: the server holds them."""

    def __init__(self, detail: str) -> None:
        super().__init__(detail, code="lease_lost")


class MissingPackage(VoleryError, ImportError):
    """Something needs a package that is not installed."""

    def __init__(self, package: str, purpose: str) -> None:
        super().__init__(
            f"{purpose} needs {package}", code="missing_package", hint=f"pip install {package}"
        )


def refusal(problem: Any, status: int) -> ServerRefused:
    """The error for a problem."""
    kinds = {401: Unauthorized, 403: Forbidden, 404: NotFound, 409: Conflict, 429: Overloaded}
    kinds.update({400: Invalid, 413: Invalid, 415: Invalid, 422: Invalid, 503: Overloaded})
    kind = kinds.get(status, ServerFailed if status >= 500 else ServerRefused)
    return kind(problem, status)
