"""Whoever streams events is woken, whatever happens to the others."""

from services.ui_api.handlers.feed import Feed


def test_a_stream_that_has_gone_keeps_no_other_asleep() -> None:
    feed = Feed()
    woken: list[str] = []

    def gone() -> None:
        raise RuntimeError("Event loop is closed")

    with feed.listening(gone), feed.listening(lambda: woken.append("a")), feed.listening(lambda: woken.append("b")):
        feed.wake()
    assert sorted(woken) == ["a", "b"]
