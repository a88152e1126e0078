"""The controller's own stop button: four states, and what leads from one to another."""

import pytest

from services.robot.core.controller_feedback import ControllerError
from services.robot.core.stop_button import after_acknowledgement, after_connection, after_feedback
from shared.robot_states import StopButton
from tests.unit.services.robot.fake_controller import BUTTON_PRESSED, BUTTON_RELEASED, FAULT, STOPPED

ABSENT, PRESSED, RELEASED, CLEAR = StopButton


@pytest.mark.parametrize(
    ("button", "error", "expected"),
    [
        (CLEAR, None, CLEAR),
        (CLEAR, STOPPED, CLEAR),
        (CLEAR, FAULT, CLEAR),
        (CLEAR, BUTTON_PRESSED, PRESSED),
        (CLEAR, BUTTON_RELEASED, RELEASED),
        (PRESSED, BUTTON_PRESSED, PRESSED),
        (PRESSED, BUTTON_RELEASED, RELEASED),
        (PRESSED, None, RELEASED),
        (RELEASED, None, RELEASED),
        (RELEASED, BUTTON_PRESSED, PRESSED),
        (ABSENT, None, ABSENT),
        (ABSENT, BUTTON_PRESSED, PRESSED),
        (ABSENT, BUTTON_RELEASED, RELEASED),
    ],
)
def test_the_button_follows_the_errors(button: StopButton, error: ControllerError | None, expected: StopButton) -> None:
    assert after_feedback(button, error) is expected


@pytest.mark.requirement("ROB-15")
def test_only_an_acknowledgement_clears_it_and_not_while_it_is_pressed() -> None:
    assert [after_acknowledgement(b) for b in StopButton] == [ABSENT, PRESSED, CLEAR, CLEAR]


def test_a_new_connection_forgets_what_was_known() -> None:
    assert [after_connection(b) for b in StopButton] == [ABSENT, RELEASED, RELEASED, RELEASED]
