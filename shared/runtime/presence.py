"""How a service shows that it is there: a liveliness token, heartbeats, and its condition."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Literal

from shared.bus.keys import Keys
from shared.bus.port import Bus, Publisher
from shared.messages.base import encode
from shared.messages.presence import Heartbeat, ServiceName, ServiceStatus
from shared.threads import supervised_thread

Condition = Literal["starting", "ready", "degraded", "stopping"]


class StatusReporter:
    """Publishes a service's condition; the last one is kept for late joiners.

    A service that does its work but is impaired, for instance by a disk that is nearly full, is degraded until the
    impairment has gone.
    """

    def __init__(self, publisher: Publisher, service: ServiceName, boot_epoch: str, version: str) -> None:
        self._publisher = publisher
        self.service: ServiceName = service
        self._boot_epoch = boot_epoch
        self._version = version
        self._lock = threading.Lock()
        self._detail = ""
        self._impaired: dict[str, str] = {}
        self._notes: list[str] = []
        self.condition: Condition | None = None

    def report(self, condition: Condition, detail: str = "") -> None:
        """Say how the service fares."""
        with self._lock:
            self.condition, self._detail = condition, detail
            self._publish(condition)

    def impair(self, cause: str, detail: str | None) -> None:
        """Say what else impairs the service, or with None that this cause has gone; nothing is sent if unchanged."""
        with self._lock:
            if self._impaired.get(cause) == detail:
                return
            if detail is None:
                del self._impaired[cause]
            else:
                self._impaired[cause] = detail
            self._publish(self.condition or "starting")

    def is_impaired_by(self, cause: str) -> bool:
        """Whether a cause impairs the service now."""
        with self._lock:
            return cause in self._impaired

    def note(self, detail: str) -> None:
        """Say for good what people should know although the service does all its work."""
        with self._lock:
            self._notes.append(detail)
            self._publish(self.condition or "starting")

    @property
    def impaired(self) -> tuple[str, ...]:
        """What impairs the service beside its own condition."""
        with self._lock:
            return tuple(self._impaired.values())

    def _publish(self, own: Condition) -> None:
        details = [self._detail, *self._impaired.values(), *self._notes]
        status = ServiceStatus(
            service=self.service,
            boot_epoch=self._boot_epoch,
            version=self._version,
            condition="degraded" if self._impaired and own == "ready" else own,
            detail="; ".join(detail for detail in details if detail),
            impaired=tuple(self._impaired),
            sent_at_ns=time.time_ns(),
        )
        self._publisher.put(encode(status))


def always() -> bool:
    """True: a service that is one process beats for as long as it runs."""
    return True


def nothing() -> None:
    """For heartbeats that nobody notes."""


@contextmanager
def beating(
    bus: Bus,
    keys: Keys,
    service: ServiceName,
    boot_epoch: str,
    rate_hz: float,
    is_alive: Callable[[], bool] = always,
    note_beat: Callable[[], None] = nothing,
) -> Iterator[None]:
    """Hold the liveliness token and send heartbeats, from a thread of their own, for as long as the context lasts.

    Parameters
    ----------
    is_alive
        Asked before every heartbeat, which is left out when the rest of the service is not.
    note_beat
        Called with every heartbeat that is sent.
    """
    ended = threading.Event()
    publisher = bus.publisher(keys.heartbeat(service))

    def beat() -> None:
        sequence, due_s = 0, time.monotonic()
        while not ended.wait(max(due_s - time.monotonic(), 0.0)):
            if is_alive():
                publisher.put(encode(Heartbeat(service=service, boot_epoch=boot_epoch, sequence=sequence)))
                note_beat()
            sequence += 1
            # From beat to beat, not from pause to pause; but after a hang, missed beats are not made up for.
            due_s = max(due_s, time.monotonic() - 1.0 / rate_hz) + 1.0 / rate_hz

    thread = supervised_thread(f"heartbeat {service}", beat)
    token = bus.presence().declare_alive(keys.alive(service))
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join(1.0)
        token.close()
        publisher.close()
