"""What is seen from outside while a fault lasts: `readyz`, and the truth about the robot."""

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Final, TypeAlias

import httpx

from benchmarks.faults.hexapod import Hexapod
from benchmarks.faults.procedure_site import ProcedureSite
from benchmarks.faults.site import FaultSite
from shared.threads import supervised_thread

_ASK_EVERY_S: Final = 0.2
_ANSWER_WITHIN_S: Final = 3.0
_LOOK_EVERY_S: Final = 0.02
# A move is over by then, whatever becomes of it.
_LOOK_FOR_S: Final = 15.0
_NO_ANSWER: Final = 0


@dataclass(frozen=True, slots=True)
class ReadyAnswer:
    """One answer of `readyz`, when it came, and what was not ready; status 0 when nobody answered.

    Attributes
    ----------
    failed
        Code of each part that was not ready, by name.
    """

    answered_s: float
    status: int
    detail: str
    failed: Mapping[str, str]

    @property
    def ready(self) -> bool:
        """Whether it said yes."""
        return self.status == httpx.codes.OK


@dataclass(slots=True)
class ReadinessWatch:
    """Asks `readyz` five times a second, each time on a connection of its own."""

    http: httpx.Client
    answers: list[ReadyAnswer] = field(default_factory=list)

    def ask(self) -> ReadyAnswer:
        """Ask once."""
        try:
            response = self.http.get("/readyz")
        except httpx.HTTPError as error:
            answer = ReadyAnswer(time.monotonic(), _NO_ANSWER, type(error).__name__, {})
        else:
            content = response.json()
            failed = {str(c["name"]): str(c["code"]) for c in content.get("checks", ()) if not c["ok"]}
            answer = ReadyAnswer(time.monotonic(), response.status_code, str(content.get("detail", "")), failed)
        self.answers.append(answer)
        return answer

    @contextmanager
    def asking(self) -> Iterator[None]:
        """Ask from a thread for as long as the context lasts."""
        ended = threading.Event()

        def repeat() -> None:
            while not ended.wait(_ASK_EVERY_S):
                self.ask()

        thread = supervised_thread("readiness watch", repeat)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()

    def last_ready_s(self, since_s: float, until_s: float) -> float | None:
        """How long after the first of two moments it last said yes before the second; None when it did not."""
        said = [a.answered_s for a in self.answers if since_s <= a.answered_s < until_s and a.ready]
        return said[-1] - since_s if said else None


@contextmanager
def readiness_of(site: FaultSite) -> Iterator[ReadinessWatch]:
    """A watch of a site's `readyz`; it keeps no connection, for a new one may be what cannot be had."""
    none_kept = httpx.Limits(max_keepalive_connections=0)
    url = site.room.installation.ports.rest_url
    with httpx.Client(base_url=url, timeout=_ANSWER_WITHIN_S, limits=none_kept) as http:
        yield ReadinessWatch(http)


SafeSince: TypeAlias = Callable[[Hexapod], float | None]


def locked_since_s(hexapod: Hexapod) -> float | None:
    """Since when it has been at rest and locked; None while it is not."""
    return hexapod.safe_since_s


def at_rest_since_s(hexapod: Hexapod) -> float | None:
    """Since when it has been at rest, held by its servo or its brake; None while it moves."""
    return hexapod.at_rest_since_s


@dataclass(frozen=True, slots=True)
class Motion:
    """What became of the platform after a moment.

    Attributes
    ----------
    safe_s
        From then to at rest and locked, measured by the controller; 0 when it has been all the time, None: never.
    travel_mm
        How far it went.
    """

    safe_s: float | None
    travel_mm: float


def motion_since(site: ProcedureSite, before: Hexapod, safe_since_s: SafeSince = locked_since_s) -> Motion:
    """Look until the platform is at rest and locked, or for long enough; `safe_since_s` may be content with less."""
    now = site.hexapod()
    while safe_since_s(now) is None and now.clock_s < before.clock_s + _LOOK_FOR_S:
        time.sleep(_LOOK_EVERY_S)
        now = site.hexapod()
    travel_mm = sum((a - b) ** 2 for a, b in zip(now.pose[:3], before.pose[:3], strict=True)) ** 0.5
    since_s = safe_since_s(now)
    return Motion(None if since_s is None else max(since_s - before.clock_s, 0.0), travel_mm)
