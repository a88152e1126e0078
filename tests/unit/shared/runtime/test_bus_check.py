"""What a service says of a bus without TLS, and of frames that go by TCP."""

import pytest
import structlog
from structlog.testing import capture_logs

from shared.bus.keys import Keys
from shared.bus.shared_memory import MemoryLimits
from shared.messages.base import decode
from shared.messages.presence import ServiceName, ServiceStatus
from shared.runtime.bus_check import check_bus
from shared.runtime.presence import StatusReporter

KEYS = Keys("or1")
ENOUGH = MemoryLimits(None, 2**40)
TOO_LITTLE = MemoryLimits(5 * 2**20, 2**40)
TLS, TCP = "tls/127.0.0.1:7447", "tcp/127.0.0.1:7447"


class Statuses:
    """Keeps what a service publishes of its condition."""

    def __init__(self) -> None:
        self.sent: list[ServiceStatus] = []

    def put(self, payload: bytes, attachment: bytes = b"") -> None:  # noqa: ARG002 - the port's signature
        self.sent.append(decode(ServiceStatus, payload))

    def close(self) -> None: ...


def checked(service: ServiceName, endpoint: str, limits: MemoryLimits) -> tuple[list[str], ServiceStatus]:
    """Events in the log, and the status of the service when it is ready afterwards."""
    statuses = Statuses()
    status = StatusReporter(statuses, service, "boot", "1")
    with capture_logs() as lines:
        check_bus(endpoint, KEYS, limits, structlog.stdlib.get_logger("test"), status)
    status.report("ready")
    return [line["event"] for line in lines], statuses.sent[-1]


def test_nothing_is_said_of_a_bus_as_it_should_be() -> None:
    said, status = checked("imaging", TLS, ENOUGH)
    assert said == []
    assert (status.condition, status.detail) == ("ready", "")


def test_a_bus_without_tls_is_warned_of() -> None:
    assert checked("robot", TCP, ENOUGH)[0] == ["bus without TLS"]


@pytest.mark.parametrize("service", ["imaging", "registration", "ui_api"])
def test_frames_that_go_by_tcp_are_warned_of_and_stay_in_the_status_of_a_service_that_is_ready(
    service: ServiceName,
) -> None:
    said, status = checked(service, TLS, TOO_LITTLE)
    assert said == ["no shared memory"]
    assert status.condition == "ready"
    assert status.detail.startswith("frames go by TCP: 5 MiB")


def test_the_robot_has_nothing_to_do_with_frames() -> None:
    said, status = checked("robot", TLS, TOO_LITTLE)
    assert (said, status.detail) == ([], "")
