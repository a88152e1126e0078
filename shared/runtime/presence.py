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

Condition = Literal["starting", "ready", "degraded", "stopping"]


class StatusReporter:
    """Publishes a service's condition; the last one is kept for late joiners."""

    def __init__(self, publisher: Publisher, service: ServiceName, boot_epoch: str, version: str) -> None:
        self._publisher = publisher
        self._service: ServiceName = service
        self._boot_epoch = boot_epoch
        self._version = version
        self.condition: Condition | None = None

    def report(self, condition: Condition, detail: str = "") -> None:
        """Say how the service fares."""
        self.condition = condition
        status = ServiceStatus(
            service=self._service,
            boot_epoch=self._boot_epoch,
            version=self._version,
            condition=condition,
            detail=detail,
            sent_at_ns=time.time_ns(),
        )
        self._publisher.put(encode(status))


@contextmanager
def beating(
    bus: Bus, keys: Keys, service: ServiceName, boot_epoch: str, rate_hz: float, on_error: Callable[[Exception], None]
) -> Iterator[None]:
    """Hold the liveliness token and send heartbeats, from a thread of their own, for as long as the context lasts.

    Parameters
    ----------
    on_error
        Called once when a heartbeat could not be sent; the beating has then ended.
    """
    ended = threading.Event()
    publisher = bus.publisher(keys.heartbeat(service))

    def beat() -> None:
        sequence, due_s = 0, time.monotonic()
        try:
            while not ended.wait(max(due_s - time.monotonic(), 0.0)):
                publisher.put(encode(Heartbeat(service=service, boot_epoch=boot_epoch, sequence=sequence)))
                sequence += 1
                # From beat to beat, not from pause to pause; but after a hang, missed beats are not made up for.
                due_s = max(due_s, time.monotonic() - 1.0 / rate_hz) + 1.0 / rate_hz
        except Exception as error:  # noqa: BLE001 - the border of a task: a service that cannot beat must end
            on_error(error)

    thread = threading.Thread(target=beat, name=f"heartbeat {service}", daemon=True)
    token = bus.presence().declare_alive(keys.alive(service))
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join(1.0)
        token.close()
        publisher.close()
