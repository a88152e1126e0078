"""How the other services fare, from what they say of themselves: token, heartbeat and status."""

from dataclasses import dataclass
from typing import Final

from services.ui_api.handlers.clock import Clock
from shared.bus.keys import Keys
from shared.bus.port import Bus, Sample
from shared.messages.base import decode
from shared.messages.presence import Heartbeat, ServiceName, ServiceStatus

# Ten heartbeats of the services that send the fewest.
SILENT_AFTER_S: Final = 2.0


@dataclass(slots=True)
class HeardService:
    """What was heard of one service, by this host's monotonic clock."""

    status: ServiceStatus | None = None
    boot_epoch: str | None = None
    heartbeat_at_s: float = float("-inf")


class ServiceHealth:
    """Listens to heartbeats and statuses from `start` on."""

    def __init__(self, bus: Bus, keys: Keys, clock: Clock, services: tuple[ServiceName, ...]) -> None:
        self._bus, self._keys, self._clock = bus, keys, clock
        self.heard: dict[ServiceName, HeardService] = {service: HeardService() for service in services}

    def start(self) -> None:
        """Begin to listen."""
        for service in self.heard:
            self._bus.subscribe(self._keys.heartbeat(service), self._on_heartbeat)
            self._bus.subscribe_retained(self._keys.status(service), self._on_status)

    def silent_for_s(self, service: ServiceName) -> float:
        """Time since the last heartbeat of a service; infinite before the first."""
        return self._clock.monotonic_s() - self.heard[service].heartbeat_at_s

    def _on_heartbeat(self, sample: Sample) -> None:
        heartbeat = decode(Heartbeat, sample.payload)
        heard = self.heard[heartbeat.service]
        heard.boot_epoch, heard.heartbeat_at_s = heartbeat.boot_epoch, self._clock.monotonic_s()

    def _on_status(self, sample: Sample) -> None:
        status = decode(ServiceStatus, sample.payload)
        self.heard[status.service].status = status
