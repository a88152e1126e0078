"""The stop button on the controller itself, in four states. Pure.

It is the hardware's, and stops without this service. What is known of it comes from the controller's error codes: 500
as long as it is pressed, 501 once it has been released. The latch of the motion table (`motion.stop_is_latched`) is
another matter: it holds for every stop, whoever asked.
"""

from enum import StrEnum
from typing import Final

STOP_BUTTON: Final = 500
STOP_BUTTON_RELEASED: Final = 501


class StopButton(StrEnum):
    """States of the button; the same names as on the bus.

    `ABSENT`: the installation has none, by its settings. `RELEASED`: not pressed any more, but nobody has acknowledged
    the stop; a service starts like that, because nobody knows what was before.
    """

    ABSENT = "absent"
    PRESSED = "pressed"
    RELEASED = "released"
    CLEAR = "clear"


def after_feedback(button: StopButton, error_code: int) -> StopButton:
    """What an answer to `ERR?` says of the button. One that should not be there and is pressed is pressed."""
    if error_code == STOP_BUTTON:
        return StopButton.PRESSED
    if error_code == STOP_BUTTON_RELEASED or button is StopButton.PRESSED:
        return StopButton.RELEASED
    return button


def after_connection(button: StopButton) -> StopButton:
    """Whatever was known of it is not known any more."""
    return button if button is StopButton.ABSENT else StopButton.RELEASED


def after_acknowledgement(button: StopButton) -> StopButton:
    """A person has found out why, and acknowledged the stop; impossible while it is pressed."""
    return StopButton.CLEAR if button is StopButton.RELEASED else button
