"""What the controller reports of itself, as one value in no controller's dialect. Pure."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from scipy.spatial.transform import Rotation

from shared.geometry.hexapod import PlatformPose, rotation_of


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


@dataclass(frozen=True, slots=True)
class Deviation:
    """Difference of two poses: distance of the pivots, angle of the rotation between them."""

    distance_mm: float
    angle_deg: float

    def exceeds(self, tolerance: "Deviation") -> bool:
        """Whether either part is larger; NaN is."""
        return not (self.distance_mm <= tolerance.distance_mm and self.angle_deg <= tolerance.angle_deg)

    def __str__(self) -> str:
        return f"{self.distance_mm:.3f} mm and {self.angle_deg:.3f}°"


READ_BACK_TOLERANCE = Deviation(0.05, 0.05)


def deviation(a: PlatformPose, b: PlatformPose) -> Deviation:
    """Difference of two poses about the same pivot."""
    difference = a.as_array() - b.as_array()
    between = rotation_of(a.as_array()[3:]).T @ rotation_of(b.as_array()[3:])
    if not np.isfinite(between).all():
        return Deviation(float("nan"), float("nan"))
    angle_rad = Rotation.from_matrix(between).magnitude()
    return Deviation(float(np.linalg.norm(difference[:3])), float(np.degrees(angle_rad)))
