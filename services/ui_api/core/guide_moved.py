"""Since when images show where the guide is: it moved with the robot, or may have moved while nobody watched it. Pure.

An image from before shows where the guide was. A plan, a verification and a hole that is drilled on its word need one
from after it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from services.ui_api.core.event_data import ImageReceived
from services.ui_api.core.robot_event_data import RobotChanged
from shared.robot_states import MotionState

BY_A_MOVE: Final = "the robot has moved since it was taken"
BY_A_REFERENCE: Final = "the robot was referenced since it was taken"
BY_A_CHANGED_SET_UP: Final = "the set-up was changed since it was taken"
BY_A_RESTART: Final = "the robot service restarted since it was taken"

# In these states nobody knows whether the brakes hold the guide where it was.
_UNWATCHED: Final[Mapping[str, str]] = {
    MotionState.FAULT: "the robot was in fault since it was taken",
    MotionState.DISCONNECTED: "the robot's controller was not connected since it was taken",
    MotionState.UNREFERENCED: "the robot was without a reference after it was taken",
    MotionState.REFERENCING: BY_A_REFERENCE,
}


@dataclass(frozen=True, slots=True)
class GuideMoved:
    """The guide moved, or may have.

    Attributes
    ----------
    because
        How, as a clause that follows an image: "the robot has moved since it was taken".
    newest
        The newest image of the case then; None when there was none.
    known
        Hashes of the images that the case had then: one that is sent again is from when it came first.
    """

    because: str
    newest: ImageReceived | None
    known: frozenset[str]

    def is_after(self, image: ImageReceived) -> bool:
        """Whether an image is from before, by what was known then or, of one that was missed, by its number."""
        return image.image_sha256 in self.known or (self.newest is not None and image.precedes(self.newest))


@dataclass(frozen=True, slots=True)
class RobotWatch:
    """The robot as it was last on record, as far as it says whether the guide is watched.

    Attributes
    ----------
    boot_epoch
        The run of the robot service; None before anything of it was on record.
    unwatched
        Why the guide may move now, as a clause that follows an image; None while the robot holds and watches it.
    """

    boot_epoch: str | None = None
    unwatched: str | None = None

    def after(self, robot: RobotChanged) -> "RobotWatch":
        """The same after a change of the robot's condition."""
        return RobotWatch(robot.boot_epoch, _UNWATCHED.get(robot.state) or self._unwatched_at_rest(robot))

    def _unwatched_at_rest(self, robot: RobotChanged) -> str | None:
        """Why the guide may move although the robot is in no state in which it may.

        Neither locked nor referenced: the controller has not answered in the last round. Nothing has changed then: the
        robot service makes a fault of it within a second, or compares where the robot stands with where it was locked.
        """
        if robot.referenced:
            return None
        is_unanswered = not robot.locked and robot.boot_epoch == self.boot_epoch
        return self.unwatched if is_unanswered else _UNWATCHED[MotionState.UNREFERENCED]

    def unwatched_until(self, robot: RobotChanged) -> str | None:
        """Why the guide may have moved until this change of the robot's condition; None when it was watched."""
        if self.boot_epoch is not None and robot.boot_epoch != self.boot_epoch:
            return BY_A_RESTART
        return self.after(robot).unwatched or self.unwatched


UNSEEN: Final = RobotWatch()
