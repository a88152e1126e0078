"""The stop button on the controller itself, in four states (`StopButton`). Pure.

It is the hardware's, and stops without this service. What is known of it comes from the errors that the controller
reports. The latch of the motion table (`motion.stop_is_latched`) is another matter: it holds for every stop, whoever
asked.

`ABSENT`: the installation has none, by its settings. `RELEASED`: not pressed any more, but nobody has acknowledged the
stop; a service starts like that, because nobody knows what was before.
"""

from services.robot.core.controller_feedback import ControllerError, ErrorKind
from shared.robot_states import StopButton


def after_feedback(button: StopButton, error: ControllerError | None) -> StopButton:
    """The button after the controller has reported an error, or none.

    A button that the settings call absent and that the controller reports as pressed is pressed.
    """
    kind = None if error is None else error.kind
    if kind is ErrorKind.STOP_BUTTON_PRESSED:
        return StopButton.PRESSED
    if kind is ErrorKind.STOP_BUTTON_RELEASED or button is StopButton.PRESSED:
        return StopButton.RELEASED
    return button


def after_connection(button: StopButton) -> StopButton:
    """Whatever was known of it is not known any more."""
    return button if button is StopButton.ABSENT else StopButton.RELEASED


def after_acknowledgement(button: StopButton) -> StopButton:
    """A person has found out why, and acknowledged the stop; impossible while it is pressed."""
    return StopButton.CLEAR if button is StopButton.RELEASED else button
