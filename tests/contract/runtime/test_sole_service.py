"""A room has place for one robot service: the second gives up before it publishes anything, on either bus."""

import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

import pytest

from shared.bus.keys import Keys
from shared.bus.port import Bus
from shared.errors import ServiceAlreadyRuns
from shared.messages.base import decode
from shared.messages.presence import Heartbeat, ServiceStatus
from shared.runtime.lifecycle import Runtime, open_service, run_service
from shared.runtime.settings import ServiceSettings
from tests.contract.bus.rooms import PATIENCE_S, Collector, Room

KEYS = Keys("sole")
SETTINGS = ServiceSettings(room="sole")


def robot_in(room: Room) -> AbstractContextManager[tuple[Bus, Runtime]]:
    return open_service("robot", SETTINGS, lambda _: room.open())


def test_a_second_robot_service_gives_up_and_publishes_nothing(room: Room) -> None:
    statuses, beats = Collector[str](), Collector[str]()
    with room.open() as listener, robot_in(room) as (_, first):
        listener.subscribe_retained(
            KEYS.status("robot"), lambda s: statuses.add(decode(ServiceStatus, s.payload).boot_epoch)
        )
        listener.subscribe(KEYS.heartbeat("robot"), lambda s: beats.add(decode(Heartbeat, s.payload).boot_epoch))
        with pytest.raises(ServiceAlreadyRuns, match="another robot service runs in room 'sole'; end it before"):
            robot_in(room).__enter__()
        beats.wait_for_last(first.boot_epoch)
        statuses.wait_for_last(first.boot_epoch)
        assert set(statuses.items) | set(beats.items) == {first.boot_epoch}
        assert not first.stop.is_set()


def test_the_command_line_ends_with_one_sentence_and_2(room: Room, capsys: pytest.CaptureFixture[str]) -> None:
    @contextmanager
    def compose(_bus: Bus, _runtime: Runtime) -> Iterator[None]:
        raise AssertionError("the second must not be composed: it would touch the controller's line")
        yield

    with robot_in(room):
        capsys.readouterr()
        assert run_service("robot", SETTINGS, compose, lambda _: room.open()) == 2
        (sentence,) = [line for line in capsys.readouterr().err.splitlines() if not line.startswith("{")]
    assert sentence == (
        "robot: another robot service runs in room 'sole'; end it before you start this one, or give this one a room "
        "of its own (DISTALOCK_ROOM)"
    )


def test_of_several_that_start_at_once_one_stays(room: Room) -> None:
    together, ended = threading.Barrier(3), threading.Event()
    outcomes = Collector[str]()

    def start() -> None:
        together.wait(PATIENCE_S)
        try:
            with robot_in(room):
                outcomes.add("stays")
                ended.wait(PATIENCE_S)
        except ServiceAlreadyRuns:
            outcomes.add("gives up")

    threads = [threading.Thread(target=start) for _ in range(3)]
    for thread in threads:
        thread.start()
    outcomes.wait_until(3)
    ended.set()
    for thread in threads:
        thread.join(PATIENCE_S)
    assert sorted(outcomes.items) == ["gives up", "gives up", "stays"]


def test_the_next_takes_the_place_of_one_that_ended(room: Room) -> None:
    with robot_in(room) as (_, first):
        pass
    with robot_in(room) as (_, second):
        assert second.boot_epoch != first.boot_epoch


def test_services_of_other_names_may_be_several(room: Room) -> None:
    with open_service("imaging", SETTINGS, lambda _: room.open()):  # noqa: SIM117 - one inside the other
        with open_service("imaging", SETTINGS, lambda _: room.open()):
            pass


def test_one_that_was_there_before_is_seen_later_too(room: Room) -> None:
    # Two that passed both steps while the link was down: the one that started later ends when it sees the other.
    with room.open() as other, robot_in(room) as (_, later):
        token = other.presence().declare_alive(KEYS.alive_as("robot", f"{1:020d}-earlier"))
        assert later.stop.wait(PATIENCE_S)
        assert later.fault is not None
        assert "another robot service runs in room 'sole'" in later.fault
        token.close()


def test_one_that_comes_later_disturbs_nobody(room: Room) -> None:
    with room.open() as other, robot_in(room) as (_, earlier):
        key = KEYS.alive_as("robot", f"{10**19:020d}-later")
        seen = threading.Event()
        other.presence().watch_alive(key, lambda _key, alive: seen.set() if alive else None)
        token = other.presence().declare_alive(key)
        assert seen.wait(PATIENCE_S)
        assert not earlier.stop.wait(0.1)
        token.close()
