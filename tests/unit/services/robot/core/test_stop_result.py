"""What is known after a stop, in figures and in words."""

import pytest

from services.robot.core.stop_result import Readback, SentStop, stop_result

SENT = SentStop(7)


def test_a_readback_that_was_begun_after_the_stop_confirms_it() -> None:
    result = stop_result(SENT, Readback(7, standstill=True, locked=True), "stopped")
    assert (result.confirmed, result.message) == (True, "")


@pytest.mark.parametrize("readback", [None, Readback(6, standstill=True, locked=True)])
def test_a_readback_from_before_the_stop_says_nothing_of_it(readback: Readback | None) -> None:
    result = stop_result(SENT, readback, "the controller is silent")
    assert (result.written, result.standstill, result.locked, result.confirmed) == (True, None, None, False)
    assert result.message == (
        "the stop was written; the controller has not shown since that the robot is at rest and locked; "
        "press the stop button on the controller (robot: the controller is silent)"
    )


@pytest.mark.parametrize(
    ("standstill", "locked", "words"),
    [(False, True, "still moves and is locked"), (True, False, "is at rest and is not locked")],
)
def test_standstill_and_lock_must_both_be_shown(*, standstill: bool, locked: bool, words: str) -> None:
    result = stop_result(SENT, Readback(8, standstill, locked), "stopped")
    assert not result.confirmed
    assert words in result.message


def test_what_was_not_written_is_not_confirmed_whatever_is_shown() -> None:
    result = stop_result(SentStop(7, "the line is cut"), Readback(7, standstill=True, locked=True), "fault")
    assert not result.confirmed
    assert result.message.startswith("the stop was not written (the line is cut); ")
