"""Pages of a list, also of one that loses its older entries between two of them."""

import pytest

from services.ui_api.handlers.refusals import Refused
from services.ui_api.routes.pages import cursor_after, page, position_of
from tests.unit.services.ui_api.room import Room


def test_pages_follow_one_another() -> None:
    first = page(range(5), None, 2, str)
    second = page(range(5), first.next_cursor, 2, str)
    last = page(range(5), second.next_cursor, 2, str)
    assert (first.items, second.items, last.items, last.next_cursor) == (["0", "1"], ["2", "3"], ["4"], None)


def test_a_list_that_loses_older_entries_leaves_none_out_of_its_next_page() -> None:
    first = page(range(10), None, 4, str)
    after_more_and_loss = page(range(3, 12), first.next_cursor, 4, str, lost=3)
    assert after_more_and_loss.items == ["4", "5", "6", "7"]
    everything_shown_is_gone = page(range(6, 12), first.next_cursor, 4, str, lost=6)
    assert everything_shown_is_gone.items == ["6", "7", "8", "9"]


@pytest.mark.parametrize("place", [10**18, 2**63 - 1, 2**63, 10**24 - 1])
def test_a_place_beyond_every_list_is_no_cursor(place: int) -> None:
    assert position_of(cursor_after(10**18 - 1)) == 10**18 - 1
    with pytest.raises(Refused, match="begin without a cursor"):
        position_of(cursor_after(place))


def test_numbers_beyond_those_of_the_database_are_refused(room: Room) -> None:
    case, beyond = f"/cases/{room.open_case()}", 2**63
    timeline = room.get(f"{case}/timeline?cursor={cursor_after(beyond)}")
    assert (timeline.status_code, timeline.json()["code"]) == (400, "cursor_invalid")
    for resource in ("localisations", "plans", "verifications", "qa-reports"):
        assert room.get(f"{case}/{resource}/{beyond}").status_code == 404
    for path in (f"/events?after={beyond}", f"{case}/timeline?limit={beyond}"):
        assert room.get(path).status_code == 422
    plan = room.post(f"{case}/plans", {"localisation": beyond, "hole_ids": ["proximal"]})
    assert (plan.status_code, room.post(f"{case}/motions", {"plan": beyond}).status_code) == (404, 404)
