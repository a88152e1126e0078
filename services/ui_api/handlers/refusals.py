"""Refusals of the gateway: a handler raises them, the transaction is rolled back, and the client gets the reason.

`RefusalKind` says what sort of refusal it is without speaking HTTP; `routes.problems` gives each kind its status.
"""

from collections.abc import Mapping
from enum import StrEnum

from shared.errors import DistalockError


class RefusalKind(StrEnum):
    """What sort of refusal it is."""

    MALFORMED = "malformed"
    UNAUTHENTICATED = "unauthenticated"
    FORBIDDEN = "forbidden"
    LOCKED = "locked"
    UNKNOWN = "unknown"
    INVALID = "invalid"
    CONFLICT = "conflict"
    PRECONDITION_MISSING = "precondition_missing"
    PRECONDITION_FAILED = "precondition_failed"
    MEDIA_TYPE = "media_type"
    NO_REPLY = "no_reply"
    UNAVAILABLE = "unavailable"


class Refused(DistalockError):
    """The gateway does not do what was asked, and nothing was done.

    Parameters
    ----------
    code
        Stable name of this very refusal.
    message
        One sentence: what was found, the limit, what to do.
    retry_after_s
        When it may be tried again, where only time helps.

    Attributes
    ----------
    current, etag
        The newest state, as it is read, where what was quoted is not the newest; None otherwise.
    """

    current: Mapping[str, object] | None = None
    etag: str | None = None

    def __init__(self, kind: RefusalKind, code: str, message: str, retry_after_s: float | None = None) -> None:
        super().__init__(message)
        self.kind = kind
        self.code = code
        self.retry_after_s = retry_after_s


def unknown(what: str, name: str, remedy: str) -> Refused:
    """Refusal because there is nothing of that name."""
    return Refused(RefusalKind.UNKNOWN, f"{what}_not_found", f"there is no {what} {name!r}; {remedy}")


def conflict(code: str, message: str) -> Refused:
    """Refusal because of the state that things are in."""
    return Refused(RefusalKind.CONFLICT, code, message)


def invalid(code: str, message: str) -> Refused:
    """Refusal because of what the request says."""
    return Refused(RefusalKind.INVALID, code, message)


def forbidden(code: str, message: str) -> Refused:
    """Refusal because of who asks."""
    return Refused(RefusalKind.FORBIDDEN, code, message)


def unauthenticated(code: str, message: str) -> Refused:
    """Refusal because nobody knows who asks."""
    return Refused(RefusalKind.UNAUTHENTICATED, code, message)
