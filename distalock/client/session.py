"""Who a client is signed in as: its tokens, and when they must be renewed."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from distalock.client.models import SessionView

# Chosen: longer than a slow answer, much shorter than the 15 minutes that an access token lasts.
_RENEW_BEFORE_S: Final = 60.0
# Requests that wait for nothing: a stop needs no valid token in the room, and signing in has none yet.
_AS_THEY_ARE: Final = frozenset({"/api/v1/robot/stop", "/api/v1/sessions", "/api/v1/sessions/refresh"})


@dataclass(frozen=True, slots=True)
class Session:
    """The tokens of a session; one that was given to the client as it is cannot be renewed.

    Attributes
    ----------
    expires_at_s
        When access ends, on the client's monotonic clock; None where nobody knows.
    """

    access_token: str | None = None
    refresh_token: str | None = None
    expires_at_s: float | None = None

    @staticmethod
    def of(view: SessionView, now_s: float) -> "Session":
        """From the answer to signing in or renewing."""
        return Session(view.access_token, view.refresh_token, now_s + view.access_expires_in_s)

    @property
    def headers(self) -> dict[str, str]:
        """What says who asks; nothing without a token."""
        return {} if self.access_token is None else {"Authorization": f"Bearer {self.access_token}"}

    def must_be_renewed(self, path: str, clock_s: Callable[[], float]) -> bool:
        """Whether access ends soon, before a request to a path."""
        if self.refresh_token is None or self.expires_at_s is None or path in _AS_THEY_ARE:
            return False
        return clock_s() > self.expires_at_s - _RENEW_BEFORE_S
