"""Whether the processes of an installation answer, as seen from outside."""

import ssl
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import httpx

# The gateway gives its own probe two seconds.
_ANSWER_WITHIN_S: Final = 3.0
# What readyz says of a service that is not there yet.
_STILL_STARTING: Final = frozenset({"absent", "silent", "starting", "stale"})
_USABLE_FOR_S: Final = 5.0


@dataclass(frozen=True, slots=True)
class Server:
    """An HTTP server, and the authority whose certificate it must have; None for HTTP, or the system's authorities."""

    url: str
    authority: Path | None = None

    def trusted(self) -> ssl.SSLContext:
        """Whose certificates count: the authority's, or the system's."""
        return ssl.create_default_context(cafile=None if self.authority is None else str(self.authority))

    def answer(self, path: str) -> httpx.Response | None:
        """What it answers; None when it does not."""
        verify = True if self.authority is None else ssl.create_default_context(cafile=str(self.authority))
        try:
            return httpx.get(f"{self.url}{path}", timeout=_ANSWER_WITHIN_S, verify=verify)
        except httpx.HTTPError:
            return None

    def answers_ok(self, path: str) -> bool:
        """Whether it answers, and has nothing to say against it."""
        answer = self.answer(path)
        return answer is not None and answer.status_code == httpx.codes.OK


class GatewayReady:
    """Whether a gateway is ready, or can at least be used: all services are there, and what is not ready stays so.

    A controller that is switched off keeps an installation from being ready, but not from being started.
    """

    def __init__(self, gateway: Server, clock_s: Callable[[], float] = time.monotonic) -> None:
        self._gateway = gateway
        self._clock_s = clock_s
        self._usable_since_s: float | None = None

    def __call__(self) -> bool:
        """Ask once."""
        answer = self._gateway.answer("/readyz")
        if answer is None or answer.status_code == httpx.codes.OK:
            return answer is not None
        codes = {check.get("code") for check in answer.json().get("checks", ())}
        if codes & _STILL_STARTING:
            self._usable_since_s = None
            return False
        now_s = self._clock_s()
        if self._usable_since_s is None:
            self._usable_since_s = now_s
        return now_s - self._usable_since_s > _USABLE_FOR_S


def why_not_ready(gateway: Server) -> str:
    """What a gateway says is not ready; empty when it is."""
    answer = gateway.answer("/readyz")
    if answer is None:
        return "the gateway does not answer"
    return "" if answer.status_code == httpx.codes.OK else str(answer.json().get("detail", answer.status_code))
