"""What a service says at its start of a bus that works, but not as it should."""

from shared.bus.access import access_table
from shared.bus.keys import Keys
from shared.bus.shared_memory import MemoryLimits, shared_memory_shortage
from shared.bus.tls import PLAIN_BUS_WARNING, SCHEME
from shared.messages.presence import ServiceName
from shared.runtime.logging import Log
from shared.runtime.presence import StatusReporter


def check_bus(endpoint: str, keys: Keys, limits: MemoryLimits, log: Log, status: StatusReporter) -> None:
    """Log a bus without TLS; log and report frames that go by TCP, in a service that sends or receives them."""
    if not endpoint.startswith(SCHEME):
        log.warning("bus without TLS", detail=PLAIN_BUS_WARNING)
    shortage = shared_memory_shortage(limits)
    if shortage is not None and _handles_frames(status.service, keys):
        log.warning("no shared memory", detail=shortage)
        status.note(shortage)


def _handles_frames(service: ServiceName, keys: Keys) -> bool:
    return any(service in {row.provider, *row.consumers} for row in access_table(keys) if row.key == keys.frame)
