"""The hexapod and its controller as they really are, whatever the service believes."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

from services.robot.core.controller_feedback import ControllerError, ControllerFeedback, ErrorKind
from services.robot.devices.controller import ReplyGarbled, StopInForce
from shared.errors import DeviceError
from shared.geometry.hexapod import ZERO_POSE, PlatformPose


class Doing(StrEnum):
    """What the hexapod does."""

    NOTHING = "rests"
    MOVE = "moves"
    REFERENCE = "references"


@dataclass(frozen=True, slots=True)
class Plant:
    """The hexapod. Its pose is left out: every plan of the model begins and ends where the robot stands.

    Attributes
    ----------
    holds_back
        Whether the controller's driver holds motion commands back since the last stop.
    error
        What the next feedback reports.
    """

    doing: Doing = Doing.NOTHING
    locked: bool = True
    referenced: bool = False
    holds_back: bool = True
    error: ErrorKind | None = None

    def ended(self) -> "Plant":
        """After a motion has come to its end by itself."""
        return replace(self, doing=Doing.NOTHING, referenced=self.referenced or self.doing is Doing.REFERENCE)


class PlantController:
    """`HexapodController` on the plant: what is asked of it happens at once, motions go on until they end.

    Attributes
    ----------
    began
        Motions that began since `plant` was set.
    stops
        How many stops arrived since then.
    before_motion
        Called in the moment before a motion begins: a stop may come just then.
    fails
        Whether the next answer is garbage.
    """

    identity = "model"

    def __init__(self) -> None:
        self.began: list[Doing] = []
        self.stops = 0
        self.fails = False
        self.before_motion: Callable[[], None] = _nothing
        self.plant = Plant()

    def load(self, plant: Plant) -> None:
        """Begin anew with a plant."""
        self.plant, self.began, self.stops, self.fails, self.before_motion = plant, [], 0, False, _nothing

    def read(self) -> ControllerFeedback:
        """As the controller reports it; reporting an error clears it."""
        if self.fails:
            raise ReplyGarbled("garbage")
        plant, self.plant = self.plant, replace(self.plant, error=None)
        moves = plant.doing is Doing.MOVE
        error = None if plant.error is None else ControllerError(plant.error, plant.error.value)
        return ControllerFeedback(ZERO_POSE, moves, not moves, plant.locked, not plant.locked, plant.referenced, error)

    def reference(self) -> None:
        """Begin reference."""
        self._begin(Doing.REFERENCE)

    def move(self, target: PlatformPose, speed_mm_per_s: float) -> None:  # noqa: ARG002 - the port's
        """Unlock and begin a move."""
        self._begin(Doing.MOVE)
        self.plant = replace(self.plant, locked=False)

    def _begin(self, motion: Doing) -> None:
        self.before_motion()
        if self.plant.holds_back:
            raise StopInForce("a stop is in force")
        self.began.append(motion)
        self.plant = replace(self.plant, doing=motion)

    def lock(self) -> None:
        """Brakes on, servos off."""
        self.plant = replace(self.plant, locked=True, doing=Doing.NOTHING)

    def stop_now(self) -> DeviceError | None:
        """Stop, lock, and hold motions back."""
        self.stops += 1
        self.plant = replace(
            self.plant, doing=Doing.NOTHING, locked=True, holds_back=True, error=ErrorKind.STOPPED_BY_COMMAND
        )
        return None

    def release_stop(self) -> None:
        """Let motions through."""
        self.plant = replace(self.plant, holds_back=False)

    def close(self) -> None:
        """Leave the line."""


def _nothing() -> None:
    """Nothing comes in between."""
