"""The controller's own stop button: four states, and what leads from one to another."""

import pytest

from services.robot.core.stop_button import StopButton, after_acknowledgement, after_connection, after_feedback
from shared.messages.robot import StopButton as WireButton

ABSENT, PRESSED, RELEASED, CLEAR = StopButton


@pytest.mark.parametrize(
    ("button", "code", "expected"),
    [
        (CLEAR, 0, CLEAR),
        (CLEAR, 10, CLEAR),
        (CLEAR, 500, PRESSED),
        (CLEAR, 501, RELEASED),
        (PRESSED, 500, PRESSED),
        (PRESSED, 501, RELEASED),
        (PRESSED, 0, RELEASED),
        (RELEASED, 0, RELEASED),
        (RELEASED, 500, PRESSED),
        (ABSENT, 0, ABSENT),
        (ABSENT, 500, PRESSED),
        (ABSENT, 501, RELEASED),
    ],
)
def test_what_an_answer_says(button: StopButton, code: int, expected: StopButton) -> None:
    assert after_feedback(button, code) is expected


def test_only_an_acknowledgement_clears_it_and_not_while_it_is_pressed() -> None:
    assert [after_acknowledgement(b) for b in StopButton] == [ABSENT, PRESSED, CLEAR, CLEAR]


def test_a_new_connection_forgets_what_was_known() -> None:
    assert [after_connection(b) for b in StopButton] == [ABSENT, RELEASED, RELEASED, RELEASED]


def test_the_bus_has_the_same_names() -> None:
    assert [b.value for b in StopButton] == [b.value for b in WireButton]
