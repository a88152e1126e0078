"""Hold-to-move leases on a clock of the test's own."""

import threading
from collections.abc import Iterator

import pytest

from services.ui_api.handlers.clock import Clock
from services.ui_api.handlers.leases import Leases

PATIENCE_S = 60.0


class HandClock:
    """A clock that stands still until it is set."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def monotonic_s(self) -> float:
        return self.now_s


class Lapses:
    """Notes which leases lapsed."""

    def __init__(self) -> None:
        self.ids: list[str] = []
        self.one = threading.Event()

    def note(self, operation_id: str) -> None:
        self.ids.append(operation_id)
        self.one.set()


@pytest.fixture
def clock() -> HandClock:
    return HandClock()


@pytest.fixture
def lapses() -> Lapses:
    return Lapses()


@pytest.fixture
def leases(clock: HandClock, lapses: Lapses) -> Iterator[Leases]:
    watched = Leases(Clock(lambda: 0, clock.monotonic_s), 0.5, lapses.note)
    watched.start()
    yield watched
    watched.close()


def test_a_lease_that_is_not_renewed_lapses(leases: Leases, clock: HandClock, lapses: Lapses) -> None:
    leases.grant("op")
    assert not leases.has_lapsed("op")
    clock.now_s += 0.6
    assert leases.has_lapsed("op")
    leases.grant("other")  # wakes the watching thread
    assert lapses.one.wait(PATIENCE_S)
    assert lapses.ids == ["op"]
    assert leases.has_lapsed("op")
    assert not leases.has_lapsed("other")


def test_a_renewed_lease_begins_anew_and_a_lapsed_one_cannot(leases: Leases, clock: HandClock) -> None:
    leases.grant("op")
    clock.now_s += 0.4
    assert leases.renew("op")
    clock.now_s += 0.4
    assert not leases.has_lapsed("op")
    clock.now_s += 0.2
    assert not leases.renew("op")


def test_a_released_lease_does_not_lapse(leases: Leases, clock: HandClock) -> None:
    leases.grant("op")
    leases.release("op")
    clock.now_s += 10.0
    assert not leases.has_lapsed("op")
    assert not leases.renew("op")


def test_leases_still_held_lapse_when_nobody_watches_any_more(lapses: Lapses) -> None:
    watched = Leases(Clock(), 60.0, lapses.note)
    watched.start()
    watched.grant("op")
    watched.close()
    assert lapses.ids == ["op"]


def test_a_lease_lapses_by_the_real_clock(lapses: Lapses) -> None:
    watched = Leases(Clock(), 0.05, lapses.note)
    watched.start()
    watched.grant("op")
    assert lapses.one.wait(PATIENCE_S)
    watched.close()
    assert lapses.ids == ["op"]


def test_only_the_newest_that_lapsed_are_remembered(leases: Leases, clock: HandClock, lapses: Lapses) -> None:
    numbers = range(1500)
    for number in numbers:
        leases.grant(f"op {number}")
    clock.now_s += 0.6
    leases.grant("last")  # wakes the watching thread
    assert lapses.one.wait(PATIENCE_S)
    assert [leases.has_lapsed(f"op {number}") for number in (0, 475, 476, 1499)] == [False, False, True, True]
