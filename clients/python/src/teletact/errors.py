"""What can go wrong, in one hierarchy. Each error keeps what the service said, in parts.

A service's message reads ``FIELD: what is wrong; what helps``. ``str(error)`` is one line that says which call ended,
how, and what to do.
"""

from __future__ import annotations

import re

import grpc

_FIELD = re.compile(r"^([a-z][a-z0-9_]*(?:(?:\.|, )[a-z][a-z0-9_]*|\[\d+\])*): ")
_LONGEST = 1000  # of what a peer says, in characters

# Where the service names no remedy.
_USUAL = {
    grpc.StatusCode.UNAVAILABLE: "the service starts, ends or cannot be reached: try again, and see its log",
    grpc.StatusCode.UNAUTHENTICATED: "give token=, or tls_certificate= and tls_key=",
    grpc.StatusCode.PERMISSION_DENIED: "ask the service's administrator for a role that may",
    grpc.StatusCode.DEADLINE_EXCEEDED: "allow more time, or ask for less",
    grpc.StatusCode.RESOURCE_EXHAUSTED: "end other calls, ask for less, or try again later",
    grpc.StatusCode.ABORTED: "make the scene again",
    grpc.StatusCode.UNIMPLEMENTED: "this client and the service are of different versions: update the older one",
    grpc.StatusCode.INTERNAL: "a fault of the service: its log says more",
}


class TeletactError(Exception):
    """Any error of this package.

    ``code``: gRPC's, also of errors found here; ``problem``: what is wrong; ``field``: which argument or field of the
    message, "" where none is named; ``remedy``: what helps, "" where nobody says; ``call``: what was called.
    """

    code: grpc.StatusCode = grpc.StatusCode.UNKNOWN

    def __init__(self, problem: str, *, field: str = "", remedy: str = "", call: str = "",
                 code: grpc.StatusCode | None = None) -> None:
        if code is not None:
            self.code = code
        self.problem, self.field, self.remedy, self.call = problem, field, remedy, call
        super().__init__(problem)

    def __str__(self) -> str:
        parts = [self.call, self.code.name, self.field]
        said = ": ".join([part for part in parts if part] + [self.problem])
        return f"{said}; {self.remedy}" if self.remedy else said


class InvalidArgument(TeletactError, ValueError):
    """A field is out of range, not finite, or of the wrong shape."""

    code = grpc.StatusCode.INVALID_ARGUMENT


class NotFound(TeletactError, LookupError):
    """There is no such scene."""

    code = grpc.StatusCode.NOT_FOUND


class AlreadyExists(TeletactError):
    """The scene's id is taken."""

    code = grpc.StatusCode.ALREADY_EXISTS


class NotPermitted(TeletactError, PermissionError):
    """The service does not know who calls (UNAUTHENTICATED), or that one may not (PERMISSION_DENIED)."""

    code = grpc.StatusCode.PERMISSION_DENIED


class FailedPrecondition(TeletactError):
    """What is there does not allow it: frames that cannot be tracked, a scene of another kind."""

    code = grpc.StatusCode.FAILED_PRECONDITION


class ResourceExhausted(TeletactError):
    """A limit of the service, or its memory."""

    code = grpc.StatusCode.RESOURCE_EXHAUSTED


class DeadlineExceeded(TeletactError, TimeoutError):
    """It was not done in time."""

    code = grpc.StatusCode.DEADLINE_EXCEEDED


class Unavailable(TeletactError, ConnectionError):
    """Nobody answers, or the service starts or ends."""

    code = grpc.StatusCode.UNAVAILABLE


class Aborted(TeletactError):
    """The scene was deleted meanwhile."""

    code = grpc.StatusCode.ABORTED


class Cancelled(TeletactError):
    """The call was cancelled, or what it wanted was replaced by something newer."""

    code = grpc.StatusCode.CANCELLED


class BadAnswer(TeletactError):
    """The service sent what the contract does not allow. Nothing of it was taken."""

    code = grpc.StatusCode.DATA_LOSS

    def __init__(self, problem: str, *, field: str = "", call: str = "") -> None:
        super().__init__(problem, field=field, call=call,
                         remedy="nothing of it was taken; is this a teletact service of this version?")


class DamagedFile(TeletactError, OSError):
    """A recording or an image that cannot be read."""

    code = grpc.StatusCode.DATA_LOSS


_BY_CODE: dict[grpc.StatusCode, type[TeletactError]] = {
    kind.code: kind for kind in (InvalidArgument, NotFound, AlreadyExists, NotPermitted, FailedPrecondition,
                                 ResourceExhausted, DeadlineExceeded, Unavailable, Aborted, Cancelled)}
_BY_CODE[grpc.StatusCode.UNAUTHENTICATED] = NotPermitted


def one_line(text: str) -> str:
    """What a peer said, as one plain line of bounded length."""
    plain = "".join(c if c.isprintable() else "?" for c in text)
    return plain if len(plain) <= _LONGEST else plain[:_LONGEST] + "..."


def from_status(code: grpc.StatusCode, details: str | None, call: str) -> TeletactError:
    """The error of a call that ended so. ``details``: the service's message."""
    said = one_line(details or "")
    field = ""
    if found := _FIELD.match(said):
        field, said = found.group(1), said[found.end():]
    problem, _, remedy = said.partition("; ")
    if said.startswith("failed to connect"):  # gRPC's own words, which name no remedy
        problem, remedy = said.replace("; ", ", "), ""
    remedy = remedy or _USUAL.get(code, "")
    kind = _BY_CODE.get(code, TeletactError)
    return kind(problem or "without a message", field=field, remedy=remedy, call=call, code=code)


def from_rpc(error: grpc.RpcError, call: str) -> TeletactError:
    """The same of what gRPC raised."""
    return from_status(error.code(), error.details(), call)
