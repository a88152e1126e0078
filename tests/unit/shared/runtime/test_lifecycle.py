"""From start to end of a service, over the in-memory bus."""

import queue
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import pytest

from shared.bus.keys import Keys
from shared.bus.memory_bus import MemoryRouter
from shared.bus.port import Bus
from shared.bus.zenoh_bus import BusSettings
from shared.errors import BusUnavailable, ConfigurationError
from shared.messages.base import decode
from shared.messages.presence import Heartbeat, ServiceStatus
from shared.runtime.lifecycle import Runtime, open_service, run_service
from shared.runtime.settings import ServiceSettings

PATIENCE_S = 60.0
KEYS = Keys("test")
SETTINGS = ServiceSettings(room="test")
Compose = Callable[[Bus, Runtime], AbstractContextManager[object]]


class Room:
    """A bus with somebody who listens to one service."""

    def __init__(self) -> None:
        self.router = MemoryRouter()
        self.statuses: queue.Queue[ServiceStatus] = queue.Queue()
        self.beats: queue.Queue[Heartbeat] = queue.Queue()
        self.alive: queue.Queue[bool] = queue.Queue()
        bus = self.router.open()
        bus.subscribe_retained(KEYS.status("imaging"), lambda s: self.statuses.put(decode(ServiceStatus, s.payload)))
        bus.subscribe(KEYS.heartbeat("imaging"), lambda s: self.beats.put(decode(Heartbeat, s.payload)))
        bus.watch_alive(KEYS.alive("imaging"), lambda _key, alive: self.alive.put(alive))

    def opener(self, _settings: BusSettings) -> AbstractContextManager[Bus]:
        return self.router.open()

    def conditions(self, count: int) -> list[str]:
        return [self.statuses.get(timeout=PATIENCE_S).condition for _ in range(count)]

    def run(self, compose: Compose) -> int:
        return run_service("imaging", SETTINGS, compose, self.opener)


@pytest.fixture
def room() -> Room:
    return Room()


def test_service_shows_itself_from_start_to_end(room: Room) -> None:
    with open_service("imaging", SETTINGS, room.opener) as (_, runtime):
        assert room.alive.get(timeout=PATIENCE_S)
        first, second = room.beats.get(timeout=PATIENCE_S), room.beats.get(timeout=PATIENCE_S)
        assert second.sequence == first.sequence + 1
        assert first.boot_epoch == runtime.boot_epoch
        runtime.ready()
        runtime.degraded("no C-arm; connect it")
    assert not room.alive.get(timeout=PATIENCE_S)
    assert room.conditions(4) == ["starting", "ready", "degraded", "stopping"]


def test_every_start_has_its_own_boot_epoch(room: Room) -> None:
    epochs = set()
    for _ in range(3):
        with open_service("imaging", SETTINGS, room.opener) as (_, runtime):
            epochs.add(runtime.boot_epoch)
    assert len(epochs) == 3


def test_clean_end_is_0_and_ready_is_said_for_the_service(room: Room) -> None:
    @contextmanager
    def compose(_bus: Bus, runtime: Runtime) -> Iterator[None]:
        runtime.stop.set()
        yield

    assert room.run(compose) == 0
    assert room.conditions(3) == ["starting", "ready", "stopping"]


def test_condition_that_the_service_reported_itself_stays(room: Room) -> None:
    @contextmanager
    def compose(_bus: Bus, runtime: Runtime) -> Iterator[None]:
        runtime.degraded("warming up")
        runtime.stop.set()
        yield

    assert room.run(compose) == 0
    assert room.conditions(3) == ["starting", "degraded", "stopping"]


def test_fault_ends_the_service_with_1(room: Room) -> None:
    @contextmanager
    def compose(_bus: Bus, runtime: Runtime) -> Iterator[None]:
        threading.Thread(target=lambda: runtime.fail("the leg fell off")).start()
        yield
        assert runtime.fault == "the leg fell off"

    assert room.run(compose) == 1


def test_unexpected_error_is_logged_and_1(room: Room, capsys: pytest.CaptureFixture[str]) -> None:
    @contextmanager
    def compose(_bus: Bus, _runtime: Runtime) -> Iterator[None]:
        raise ZeroDivisionError("surprise")
        yield

    assert room.run(compose) == 1
    (fault,) = [line for line in capsys.readouterr().err.splitlines() if '"fault"' in line]
    assert "ZeroDivisionError" in fault
    assert '"service": "imaging"' in fault
    assert room.conditions(2) == ["starting", "stopping"]


@pytest.mark.parametrize("error", [ConfigurationError("port 104 is in use"), BusUnavailable("no router; start it")])
def test_start_that_cannot_be_is_one_line_and_2(error: Exception, capsys: pytest.CaptureFixture[str]) -> None:
    def opener(_settings: BusSettings) -> AbstractContextManager[Bus]:
        raise error

    def compose(_bus: Bus, _runtime: Runtime) -> AbstractContextManager[object]:
        raise AssertionError("must not be composed")

    assert run_service("imaging", SETTINGS, compose, opener) == 2
    assert capsys.readouterr().err == f"imaging: {error}\n"
