"""The newest events are read and rendered once for all who follow the log."""

from services.ui_api.core.event_data import GatewayStarted
from services.ui_api.core.events import Event
from services.ui_api.handlers.event_tail import _KEPT, EventTail


def event(sequence: int) -> Event:
    return Event(sequence, 0, None, "gateway", "", GatewayStarted("e", "1"))


def test_what_is_new_comes_in_its_order() -> None:
    tail = EventTail(10)
    news = tail.after(10)
    assert news is not None
    assert (news.events, news.through) == ((), 10)
    tail.take([event(11), event(12)])
    tail.take([event(13)])
    for place in (10, 11, 13):
        news = tail.after(place)
        assert news is not None
        assert [one.event.sequence for one in news.events] == list(range(place + 1, 14))
        assert news.through == 13


def test_who_is_far_behind_is_told_to_read_the_database() -> None:
    tail = EventTail(10)
    assert tail.after(9) is None
    tail.take([event(number) for number in range(11, 11 + _KEPT + 5)])
    assert tail.after(10) is None
    assert tail.after(15) is not None


def test_a_place_beyond_the_end_has_no_news() -> None:
    news = EventTail(10).after(12)
    assert news is not None
    assert (news.events, news.through) == ((), 12)


def test_an_event_is_rendered_once() -> None:
    tail, rendered = EventTail(0), list[int]()
    tail.take([event(1)])

    def render(one: Event) -> str:
        rendered.append(one.sequence)
        return "text"

    for _ in range(50):
        news = tail.after(0)
        assert news is not None
        assert news.events[0].rendered(render) == "text"
    assert rendered == [1]
