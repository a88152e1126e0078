"""What counts as harm, defined before the first run and judged by the virtual room's truth alone.

1. *Wrong axis*: the system said that a hole may be drilled, nothing moved after its last image, and the guide's axis is
   off by more than 1 mm at the hole's entry or 1.5°.
2. *Struck*: the same, and the drill strikes the nail instead of passing.
3. *Unpermitted motion*: the platform moves while no permitted motion is under way.
4. *Off the way*: a motion leaves the straight way of its plan by more than the path's tolerance.
5. *Motion after a stop*: more than 1 mm after a stop, unless the line to the controller is cut (`hazards.yaml`, H12).
6. *Unheld*: the platform is held by neither brake nor servo.
7. *Motion with something inside*: the platform moves while a tool is reported in guide or bone.
8. *Wrong side*: a motion begins although the images state another side than the case.
9. *Crash*: the robot service's worker ends by an exception.

A procedure that ends by another exception has an ending of its own, `crashed`, and is a bug as well.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np

from benchmarks.campaign.rows import DrilledHole
from benchmarks.robot.rig import Rig
from services.robot.core.deviation import Deviation
from services.robot.core.supervision import distance_from_path
from services.robot.core.tuning import SUPERVISION
from shared.geometry.hexapod import PlatformPose
from shared.robot_states import MotionState
from simulation.controller.faults import LINE_FAULTS, Fault

MOST_ENTRY_MM: Final = 1.0
MOST_ANGLE_DEG: Final = 1.5
MOST_AFTER_STOP_MM: Final = 1.0
# Chosen: above what rounding does to a pose, below anything that matters.
_STILL_MM: Final = 1e-6
# What the virtual controller's slipping brake and its own error wave may move a platform that is held.
_SLIP_MM: Final = 0.5
# A controller that does not hear cannot be told to stop: while these last, a move goes on to its target.
UNHEARD: Final = LINE_FAULTS | {Fault.POWER_CYCLE}
_UNDER_WAY: Final = (MotionState.MOVING, MotionState.REFERENCING)


def harm_of(hole: DrilledHole) -> str:
    """Harm of a drilled hole, or nothing."""
    if not hole.allowed or hole.slipped:
        return ""
    if hole.entry_mm > MOST_ENTRY_MM or hole.angle_deg > MOST_ANGLE_DEG:
        return f"wrong axis: '{hole.hole_id}' is off by {hole.entry_mm:.2f} mm and {hole.angle_deg:.2f}°"
    return "" if hole.passed else f"struck: the drill in '{hole.hole_id}' did not pass, off by {hole.entry_mm:.2f} mm"


@dataclass(slots=True)
class MotionWatch:
    """Holds the truth of the virtual robot against what was permitted, after every moment of time.

    Attributes
    ----------
    way
        Start and target of the newest motion that the robot accepted.
    inside
        Whether a tool is reported in guide or bone.
    wrong_side
        Whether the images state another side than the case.
    """

    rig: Rig
    way: tuple[PlatformPose, PlatformPose] | None = None
    inside: bool = False
    wrong_side: bool = False
    harms: list[str] = field(default_factory=list)
    _last: PlatformPose = field(init=False)
    _stopped_at: PlatformPose | None = None
    _unheard: bool = False
    _awaits_stop: bool = False

    def __post_init__(self) -> None:
        self._last = self.rig.virtual.snapshot().pose

    def note_stop(self) -> None:
        """Somebody or something asked for a stop now."""
        self._stopped_at = self.rig.virtual.snapshot().pose

    def note_stop_when_at_rest(self) -> None:
        """A fault is about to come that the services answer with a stop: from where they did it is measured."""
        self._awaits_stop = True

    def permit(self, way: tuple[PlatformPose, PlatformPose]) -> None:
        """The robot has accepted a motion."""
        self.way, self._stopped_at, self._unheard, self._awaits_stop = way, None, False, False

    def tick(self, seconds: float) -> None:
        """Let time pass, and compare."""
        state = self.rig.status.state
        self.rig.tick(seconds)
        truth = self.rig.virtual.snapshot()
        if self._awaits_stop and self.rig.status.state not in _UNDER_WAY:
            self._awaits_stop, self._stopped_at = False, truth.pose
        self._unheard |= bool(truth.faults & UNHEARD)
        if truth.was_unheld:
            self._note("unheld: the platform was held by neither brake nor servo")
        if self.rig.crashes:
            self._note(f"crash: {self.rig.crashes[0]}")
        moved = truth.pose.as_array() - self._last.as_array()
        self._last = truth.pose
        allowed_mm = _SLIP_MM if truth.faults & {Fault.BRAKE_SLIPS} and state not in _UNDER_WAY else _STILL_MM
        if float(np.abs(moved).max()) > allowed_mm:
            self._compare_motion(truth.pose, state)

    def _compare_motion(self, pose: PlatformPose, state: MotionState) -> None:
        if self.way is None:
            self._note(f"unpermitted motion: moved in the state '{state}' without a permitted plan")
        elif distance_from_path(*self.way, pose).exceeds(_with_error(SUPERVISION.path)):
            self._note(f"off the way: {pose}")
        elif state not in _UNDER_WAY and not self._unheard:
            self._note(f"unpermitted motion: moved in the state '{state}'")
        if self.inside and not self._unheard:
            self._note("motion with something inside")
        if self.wrong_side:
            self._note("wrong side: moved although the images state the other one")
        if self._stopped_at is not None and not self._unheard:
            after_mm = float(np.linalg.norm(pose.as_array()[:3] - self._stopped_at.as_array()[:3]))
            if after_mm > MOST_AFTER_STOP_MM:
                self._note(f"motion after a stop: {after_mm:.2f} mm")

    def _note(self, what: str) -> None:
        if what.partition(":")[0] not in {one.partition(":")[0] for one in self.harms}:
            self.harms.append(what)


def _with_error(path: Deviation) -> Deviation:
    """The path's tolerance is of measured poses; the platform's own error comes on top of it."""
    return Deviation(path.distance_mm + 0.06, path.angle_deg + 0.04)
