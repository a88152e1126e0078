"""Counting refusals: what is published when, in bounded memory."""

from shared.bus.refusal_tally import AGAIN_AFTER_S, AT_MOST_EVERY_S, RefusalTally
from shared.bus.router_log import Refusal
from shared.messages.refusals import MOST_REFUSALS, RefusalCode


def put_on(key: str) -> Refusal:
    return Refusal(RefusalCode.MESSAGE_DENIED, "imaging", "Put", key)


def test_the_same_refusal_again_counts_up() -> None:
    tally = RefusalTally("run-1")
    for at_ns in (1, 2, 3):
        tally.note(put_on("a"), at_ns)
    tally.note(Refusal(RefusalCode.LINK_REFUSED, "", "UnknownIssuer"), 4)
    due = tally.due(100.0)
    assert due is not None
    message, changed = due
    assert (message.messages_denied, message.links_refused, message.unknown_names) == (3, 1, 0)
    assert [(entry.key, entry.times, entry.last_at_ns) for entry in message.newest] == [("a", 3, 3), ("", 1, 4)]
    assert changed == message.newest


def test_a_change_is_published_at_most_once_a_second_and_everything_again_later() -> None:
    tally = RefusalTally("run-1")
    assert tally.due(100.0) is not None, "who joins must hear that there is nothing"
    tally.note(put_on("a"), 1)
    assert tally.due(100.0 + 0.9 * AT_MOST_EVERY_S) is None
    assert tally.due(100.0 + AT_MOST_EVERY_S) is not None
    assert tally.due(100.0 + 0.9 * AGAIN_AFTER_S) is None
    again = tally.due(101.0 + AGAIN_AFTER_S)
    assert again is not None
    message, changed = again
    assert (len(message.newest), changed) == (1, ())


def test_a_flood_of_different_keys_fills_no_memory_and_is_counted() -> None:
    tally = RefusalTally("run-1")
    for number in range(10 * MOST_REFUSALS):
        tally.note(put_on(f"key/{number}"), number)
    due = tally.due(100.0)
    assert due is not None
    message, changed = due
    assert message.messages_denied == 10 * MOST_REFUSALS
    assert len(message.newest) == len(changed) == MOST_REFUSALS
    assert message.newest[-1].key == f"key/{10 * MOST_REFUSALS - 1}"


def test_lost_lines_are_told() -> None:
    tally = RefusalTally("run-1")
    tally.note_gap()
    due = tally.due(100.0)
    assert due is not None
    assert due[0].gaps == 1
