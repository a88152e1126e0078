"""What the router refuses, on record at a bounded rate."""

from pathlib import Path

from services.ui_api.core.bus_event_data import BusRefused
from services.ui_api.handlers.bus_refusals import MOST_AT_ONCE, ONE_MORE_AFTER_S, BusRefusalLog, summary
from shared.bus.keys import Keys
from shared.messages.base import encode
from shared.messages.refusals import BusRefusal, BusRefusals, RefusalCode
from shared.runtime.clock import Clock
from tests.unit.services.ui_api.room import ROOM, open_room


class Hand:
    """A clock that stands still until it is set."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.clock = Clock(monotonic_s=lambda: self.now_s)


def entry(key: str, times: int) -> BusRefusal:
    return BusRefusal(
        code=RefusalCode.MESSAGE_DENIED, service="imaging", what="Put", key=key, times=times, last_at_ns=times
    )


def report(*newest: BusRefusal, epoch: str = "run-1", gaps: int = 0) -> BusRefusals:
    denied = sum(one.times for one in newest)
    return BusRefusals(
        router_epoch=epoch, messages_denied=denied, links_refused=0, unknown_names=0, gaps=gaps, newest=newest
    )


def test_only_what_is_new_is_recorded() -> None:
    log = BusRefusalLog(Hand().clock)
    assert log.note(report()) is None
    first, again, more = (log.note(report(entry("a", times))) for times in (2, 2, 3))
    assert first is not None
    assert [(one.service, one.key, one.times) for one in first.refusals] == [("imaging", "a", 2)]
    assert again is None
    assert more is not None
    other = log.note(report(entry("a", 3), entry("b", 1)))
    assert other is not None
    assert [one.key for one in other.refusals] == ["b"]
    assert other.messages_denied == 4


def test_another_run_of_the_router_counts_anew() -> None:
    log = BusRefusalLog(Hand().clock)
    assert log.note(report(entry("a", 2))) is not None
    assert log.note(report(entry("a", 2), epoch="run-2")) is not None


def test_a_gap_is_on_record_too() -> None:
    log = BusRefusalLog(Hand().clock)
    event = log.note(report(gaps=1))
    assert event is not None
    assert event.gaps == 1
    assert log.note(report(gaps=1)) is None


def test_who_never_stops_does_not_fill_the_record_and_is_on_it_all_the_same() -> None:
    hand = Hand()
    log = BusRefusalLog(hand.clock)
    recorded = [log.note(report(entry("a", times))) for times in range(1, 10 * MOST_AT_ONCE)]
    assert sum(event is not None for event in recorded) == MOST_AT_ONCE
    hand.now_s += ONE_MORE_AFTER_S
    late = log.note(report(entry("a", 1000)))
    assert late is not None
    assert late.refusals[0].times == 1000
    assert log.note(report(entry("a", 1001))) is None


def test_figures_and_sentence_before_and_after_a_report() -> None:
    log = BusRefusalLog(Hand().clock)
    assert all(figure != figure for figure in log.figures().values())
    log.note(report(entry("a", 2)))
    assert log.figures()[RefusalCode.MESSAGE_DENIED] == 2
    assert summary(log.newest).endswith(
        "denied 2 messages, refused 0 links and met 0 unknown names; the newest: imaging, Put a"
    )
    assert "has not reported" in summary(None)


def test_a_refusal_is_on_record_in_the_figures_and_in_readyz_which_stays_ready(tmp_path: Path) -> None:
    with open_room(tmp_path) as room, room.router.open() as router:
        router.publisher(Keys(ROOM).bus_refusals).put(encode(report(entry("a", 2))))
        room.log.wait_for_event(lambda event: isinstance(event.data, BusRefused) and event.who == "router")
        assert 'distalock_bus_refusals{code="message_denied"} 2.0' in room.client.get("/metrics").text
        ready = room.client.get("/readyz")
        (access,) = (check for check in ready.json()["checks"] if check["name"] == "access")
        assert access["ok"]
        assert "imaging, Put a" in access["measured"]
