"""Bounded hand-over between threads."""

import threading

from hypothesis import given
from hypothesis import strategies as st

from shared.runtime.latest import BoundedQueue, LatestSlot

PATIENCE_S = 60.0


def test_slot_keeps_only_the_newest_and_counts_what_it_replaced() -> None:
    slot: LatestSlot[int] = LatestSlot()
    for value in (1, 2, 3):
        slot.put(value)
    assert slot.take(0.0) == 3
    assert slot.take(0.0) is None
    assert slot.replaced == 2


@given(st.lists(st.integers(), max_size=20), st.integers(1, 5))
def test_queue_keeps_the_oldest_in_order_and_counts_what_it_refused(values: list[int], size: int) -> None:
    queue: BoundedQueue[int] = BoundedQueue(size)
    taken = [queue.put(value) for value in values]
    assert taken == [index < size for index in range(len(values))]
    assert len(queue) == min(size, len(values))
    assert queue.refused == max(len(values) - size, 0)
    assert [queue.take(0.0) for _ in values[:size]] == values[:size]
    assert queue.take(0.0) is None


def test_taking_waits_for_a_value() -> None:
    for hand_over in (LatestSlot[str](), BoundedQueue[str](1)):
        taken: list[str | None] = []
        taker = threading.Thread(target=lambda h=hand_over, t=taken: t.append(h.take(PATIENCE_S)))
        taker.start()
        hand_over.put("here")
        taker.join(PATIENCE_S)
        assert taken == ["here"]


def test_closing_wakes_whoever_waits_and_hands_nothing_out() -> None:
    for hand_over in (LatestSlot[str](), BoundedQueue[str](2)):
        taken: list[str | None] = []
        taker = threading.Thread(target=lambda h=hand_over, t=taken: t.append(h.take()))
        taker.start()
        hand_over.close()
        taker.join(PATIENCE_S)
        assert taken == [None]
        hand_over.put("late")
        assert hand_over.take() is None


def test_closed_queue_refuses() -> None:
    queue: BoundedQueue[int] = BoundedQueue(1)
    queue.close()
    assert not queue.put(1)
    assert queue.refused == 1
