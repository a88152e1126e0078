"""How many connections and requests the front takes at once."""

import pytest

from services.ui_api.front.admission import RESERVED_HANDLES, Admission, Limits, Place


@pytest.mark.parametrize("handles", [256, 1024, 4096, 1048576])
def test_connections_and_requests_together_leave_the_reserve(handles: int) -> None:
    limits = Limits.of(handles)
    assert limits.connections + limits.relays + RESERVED_HANDLES <= handles
    assert limits.relays >= 8
    assert limits.connections > limits.relays, "one that waits for its request must be there to make room"


def test_the_connection_that_was_idle_the_longest_makes_room() -> None:
    closed: list[str] = []
    admission = Admission(Limits(connections=3, relays=1))
    places = {name: Place(lambda name=name: closed.append(name)) for name in "abcd"}  # type: ignore[misc]
    for name in "abc":
        admission.enter(places[name])
    admission.busy(places["a"])
    admission.busy(places["b"])
    admission.idle(places["b"])  # later than c
    admission.enter(places["d"])
    assert closed == ["c"]
    assert (admission.connections, admission.closed_idle) == (3, 1)


def test_a_request_beyond_the_bound_is_refused_until_one_has_ended() -> None:
    admission = Admission(Limits(connections=4, relays=1))
    assert admission.take_relay()
    assert not admission.take_relay()
    admission.end_relay()
    assert admission.take_relay()
    assert admission.refused == 1
