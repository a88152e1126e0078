"""Error codes of GCS 2.0 in neutral terms."""

import pytest

from services.robot.core.controller_feedback import ErrorKind
from services.robot.devices.gcs.errors import controller_error


@pytest.mark.parametrize(
    ("code", "kind", "begins"),
    [
        (1, ErrorKind.FAULT, "the controller did not understand a command"),
        (5, ErrorKind.FAULT, "an axis is not referenced or its servo is off"),
        (7, ErrorKind.FAULT, "a target is outside the controller's limits"),
        (10, ErrorKind.STOPPED_BY_COMMAND, "the controller was stopped by a command"),
        (500, ErrorKind.STOP_BUTTON_PRESSED, "the controller's stop button is pressed"),
        (501, ErrorKind.STOP_BUTTON_RELEASED, "the controller's stop button was pressed and is released"),
        (-1024, ErrorKind.FAULT, "a leg does not follow (motion error)"),
        (99, ErrorKind.FAULT, "the controller reports error 99; see its manual, then reset"),
    ],
)
def test_every_code_has_a_kind_and_a_sentence(code: int, kind: ErrorKind, begins: str) -> None:
    error = controller_error(code)
    assert error is not None
    assert error.kind is kind
    assert error.message.startswith(begins)
    assert error.is_stop is (kind is not ErrorKind.FAULT)


def test_no_error_is_none() -> None:
    assert controller_error(0) is None
