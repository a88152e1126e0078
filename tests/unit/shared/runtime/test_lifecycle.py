"""From start to end of a service, over the in-memory bus."""

import queue
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

import pytest

from shared.bus.keys import Keys
from shared.bus.memory_bus import MemoryRouter
from shared.bus.port import Bus, Sample
from shared.bus.zenoh_bus import BusSettings
from shared.errors import BusUnavailable, ConfigurationError, InputError
from shared.messages.base import decode
from shared.messages.presence import Heartbeat, ServiceStatus
from shared.runtime.lifecycle import Runtime, open_service, run_service
from shared.runtime.settings import ServiceSettings
from shared.threads import supervised_thread

PATIENCE_S = 60.0
KEYS = Keys("test")
SETTINGS = ServiceSettings(room="test")
Compose = Callable[[Bus, Runtime], AbstractContextManager[object]]


class Room:
    """A bus with somebody who listens to one service."""

    def __init__(self, router: MemoryRouter | None = None) -> None:
        self.router = router or MemoryRouter()
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


class HeartlessRouter(MemoryRouter):
    """Takes no heartbeats, as a session that was closed."""

    def deliver(self, sample: Sample) -> bool:
        if sample.key == KEYS.heartbeat("imaging"):
            raise BusUnavailable("the session is closed")
        return super().deliver(sample)


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


def test_a_fault_is_the_last_thing_that_the_terminal_hears(room: Room, capsys: pytest.CaptureFixture[str]) -> None:
    @contextmanager
    def compose(_bus: Bus, runtime: Runtime) -> Iterator[None]:
        runtime.fail("the leg fell off")
        yield

    assert room.run(compose) == 1
    assert capsys.readouterr().err.splitlines()[-1] == "imaging: fault: the leg fell off"


def test_what_comes_first_at_a_fault_is_done_even_if_another_such_act_fails(room: Room) -> None:
    done: list[str] = []
    with open_service("robot", SETTINGS, room.opener) as (_, runtime):
        runtime.first_on_fault += [lambda _: 1 / 0, done.append]  # type: ignore[list-item]
        runtime.fail("the leg fell off")
        assert done == ["the leg fell off"]
        assert runtime.stop.is_set()


def test_an_exception_of_a_thread_is_a_fault_of_the_service(room: Room) -> None:
    @contextmanager
    def compose(_bus: Bus, runtime: Runtime) -> Iterator[None]:
        supervised_thread("legs", lambda: 1 / 0).start()
        yield
        assert runtime.fault == "thread 'legs' ended with ZeroDivisionError: division by zero"

    assert room.run(compose) == 1


def test_a_heartbeat_that_cannot_be_sent_is_a_fault() -> None:
    with open_service("imaging", SETTINGS, Room(HeartlessRouter()).opener) as (_, runtime):
        assert runtime.stop.wait(PATIENCE_S)
        assert runtime.fault == "thread 'heartbeat imaging' ended with BusUnavailable: the session is closed"


def test_an_error_that_nobody_foresaw_impairs_a_service_until_it_is_long_ago(room: Room) -> None:
    with open_service("imaging", SETTINGS, room.opener) as (_, runtime):
        runtime.ready("on port 104")
        runtime.note_error("bus handler of 'plan'", InputError("no plan"))
        runtime.note_error("bus handler of 'plan'", ZeroDivisionError("by zero"))
        assert room.conditions(2) == ["starting", "ready"]
        status = room.statuses.get(timeout=PATIENCE_S)
        assert status.condition == "degraded"
        assert status.detail == (
            "on port 104; bus handler of 'plan' brought ZeroDivisionError: by zero (2 so far); see the log"
        )
        runtime.forget_errors()
        assert room.statuses.empty()
        runtime.last_error_s = float("-inf")
        runtime.forget_errors()
        assert room.conditions(1) == ["ready"]
        assert runtime.fault is None


def test_an_error_that_nobody_foresaw_is_a_fault_of_the_robot(room: Room) -> None:
    with open_service("robot", SETTINGS, room.opener) as (_, runtime):
        runtime.note_error("bus handler of 'plan'", InputError("no plan"))
        assert runtime.fault is None
        runtime.note_error("bus handler of 'plan'", ZeroDivisionError("by zero"))
        assert runtime.fault == "bus handler of 'plan' brought ZeroDivisionError: by zero"


def test_a_disk_that_is_nearly_full_degrades_a_service_until_space_returns(room: Room) -> None:
    settings = ServiceSettings(room="test", least_free_mib=1e12)
    with open_service("imaging", settings, room.opener) as (_, runtime):
        runtime.ready()
        while (status := room.statuses.get(timeout=PATIENCE_S)).condition != "degraded":
            pass
        assert "MiB free (limit 1e+12 MiB); free some space" in status.detail
        runtime.status.impair("disk", None)
        assert room.conditions(1) == ["ready"]


@pytest.mark.parametrize("error", [ConfigurationError("port 104 is in use"), BusUnavailable("no router; start it")])
def test_start_that_cannot_be_is_one_line_and_2(error: Exception, capsys: pytest.CaptureFixture[str]) -> None:
    def opener(_settings: BusSettings) -> AbstractContextManager[Bus]:
        raise error

    def compose(_bus: Bus, _runtime: Runtime) -> AbstractContextManager[object]:
        raise AssertionError("must not be composed")

    assert run_service("imaging", SETTINGS, compose, opener) == 2
    assert capsys.readouterr().err == f"imaging: {error}\n"
