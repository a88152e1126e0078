"""Which images are on record is known by ranges of their numbers, however long a gap stays."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.ui_api.core.case import Case
from services.ui_api.core.event_data import ImageReceived
from services.ui_api.core.image_numbers import NumbersOnRecord, unfinished
from tests.unit.services.ui_api import samples


@pytest.mark.parametrize(
    ("noted", "through", "beyond"),
    [
        ([1, 2, 3], 3, ()),
        ([1, 3, 4], 1, ((3, 4),)),
        ([3, 1, 2], 3, ()),
        ([2, 2], 0, ((2, 2),)),
        ([5, 4, 2, 1], 2, ((4, 5),)),
        ([2, 5, 3, 4], 0, ((2, 5),)),
    ],
)
def test_numbers_on_record_show_their_gaps(noted: list[int], through: int, beyond: tuple[tuple[int, int], ...]) -> None:
    known = NumbersOnRecord()
    for number in noted:
        known = known.with_number(number)
    assert (known.through, known.beyond) == (through, beyond)
    assert [number for number in range(1, 8) if number in known] == sorted(set(noted))


def test_of_a_run_only_the_newest_image_is_asked_for() -> None:
    images = tuple(
        ImageReceived(name, "1.2", 0, 1, None, "store-1", number, in_run)
        for number, (name, in_run) in enumerate([("single", False), ("frame", True), ("last", True)], 1)
    )
    case = Case("case-1", 0, 0, 1, samples.case_setup(), images=images)
    assert [one.image_sha256 for one in unfinished(case).to_calibrate] == ["single"]
    assert unfinished(case).to_localise == ()


@given(st.lists(st.integers(1, 40)))
def test_numbers_on_record_are_those_that_were_noted(numbers: list[int]) -> None:
    known = NumbersOnRecord()
    for number in numbers:
        known = known.with_number(number)
    assert [number for number in range(1, 42) if number in known] == sorted(set(numbers))
    assert all(last + 1 < first for (_, last), (first, _) in pairwise(((0, known.through), *known.beyond)))


def test_what_is_held_does_not_grow_with_the_images_after_a_gap() -> None:
    known = NumbersOnRecord()
    for number in range(2, 1000):
        known = known.with_number(number)
    assert known == NumbersOnRecord(0, ((2, 999),))
