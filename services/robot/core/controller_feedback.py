"""What the controller reports of itself, as one value in no controller's dialect. Pure."""

from dataclasses import dataclass
from enum import StrEnum

from shared.geometry.hexapod import PlatformPose


class ErrorKind(StrEnum):
    """What an error of the controller means for the motion table, whatever its dialect calls it."""

    STOPPED_BY_COMMAND = "stopped_by_command"
    STOP_BUTTON_PRESSED = "stop_button_pressed"
    STOP_BUTTON_RELEASED = "stop_button_released"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class ControllerError:
    """An error that the controller reported.

    Attributes
    ----------
    message
        One sentence: what happened, and what to do.
    """

    kind: ErrorKind
    message: str

    @property
    def is_stop(self) -> bool:
        """Whether it means that the controller was stopped, and not that something is wrong."""
        return self.kind is not ErrorKind.FAULT


@dataclass(frozen=True, slots=True)
class ControllerFeedback:
    """One round of questions to the controller.

    Attributes
    ----------
    pose
        Where the platform is.
    moving
        Whether any axis moves.
    on_target
        Whether all axes report that they stand on their target.
    locked
        Every brake on and every servo off.
    unlocked
        Every brake off and every servo on; neither `locked` nor `unlocked` is a mixture, which is never right.
    referenced
        Every axis.
    error
        The newest error since the last round; None for none.
    """

    pose: PlatformPose
    moving: bool
    on_target: bool
    locked: bool
    unlocked: bool
    referenced: bool
    error: ControllerError | None
