"""A rig that is watched: the truth of the virtual robot is held against what was permitted and what is said."""

from dataclasses import dataclass, field

import numpy as np

from benchmarks.robot.rig import Rig, SentCommand
from services.robot.core.supervision import distance_from_path
from services.robot.core.tuning import SUPERVISION
from shared.errors import NoReply
from shared.geometry.hexapod import PlatformPose
from shared.messages.robot import CommandReply
from shared.robot_states import MotionState
from simulation.controller.faults import LINE_FAULTS, Fault
from simulation.controller.hexapod_model import SLIP_MM

STILL_MM = 1e-6
# A controller that does not hear cannot be told to stop: while these last, a move goes on to its target.
UNHEARD = LINE_FAULTS | {Fault.POWER_CYCLE}


@dataclass(slots=True)
class Watched:
    """A rig, what was permitted on it, and what went wrong."""

    rig: Rig
    wrong: list[str] = field(default_factory=list)
    done: list[str] = field(default_factory=list)
    faults: set[Fault] = field(default_factory=set)
    plan_json: bytes | None = None
    plan_target: PlatformPose | None = None
    accepted: list[PlatformPose] = field(default_factory=list)
    way: tuple[PlatformPose, PlatformPose] | None = None
    unheard_since_move: bool = False
    old_commands: list[SentCommand] = field(default_factory=list)
    last_pose: PlatformPose = field(init=False)

    def __post_init__(self) -> None:
        self.last_pose = self.rig.virtual.snapshot().pose

    def tick(self, seconds: float = 0.1) -> None:
        """Let time pass, and compare."""
        was_moving = self.rig.status.state is MotionState.MOVING
        self.unheard_since_move |= bool(self.faults & UNHEARD)
        self.rig.tick(seconds)
        self._compare(was_moving=was_moving)

    def ask(self, command: SentCommand) -> CommandReply | None:
        """Send a command; None when the link is down. It may come again later."""
        self.old_commands.append(command)
        try:
            return self.rig.ask(command)
        except NoReply:
            return None

    def _compare(self, *, was_moving: bool) -> None:
        truth = self.rig.virtual.snapshot()
        self._compare_pose(truth.pose, was_moving=was_moving)
        if truth.was_unheld:
            self._report("the platform was held by neither brake nor servo")
        says_locked = self.rig.state.locked and self.rig.state.state == "locked" and not self.faults
        if says_locked and (truth.servo_on or not truth.brake_on or truth.moving):
            self._report("the service says 'locked', the robot is not")
        self._compare_moves_sent()
        if self.rig.crashes:
            self._report(f"the service crashed: {self.rig.crashes}")

    def _compare_pose(self, pose: PlatformPose, *, was_moving: bool) -> None:
        moved = pose.as_array() - self.last_pose.as_array()
        self.last_pose = pose
        if Fault.BRAKE_SLIPS in self.faults and abs(moved[2] + SLIP_MM) < STILL_MM:
            moved[2] = 0.0
        if np.abs(moved).max() < STILL_MM:
            return
        if self.way is None:
            self._report(f"moved by {moved.round(4).tolist()} without any permitted plan")
        elif distance_from_path(*self.way, pose).exceeds(SUPERVISION.path):
            self._report(f"left the permitted way: {pose}")
        elif not was_moving and not self.unheard_since_move:
            self._report(f"moved by {moved.round(4).tolist()} in the state '{self.rig.status.state}'")

    def _compare_moves_sent(self) -> None:
        permitted = [_as_sent(target) for target in self.accepted]
        for line in self.rig.sent_moves:
            if line not in permitted:
                self._report(f"sent {line!r}, which no accepted command asked for")
            elif self.rig.sent_moves.count(line) > permitted.count(line):
                self._report(f"sent {line!r} twice")

    def _report(self, what: str) -> None:
        self.wrong.append(f"{what}; after: {', '.join(self.done)}")


def _as_sent(target: PlatformPose) -> str:
    return "MOV " + " ".join(f"{a} {v:.6f}" for a, v in zip("XYZUVW", target.as_array(), strict=True))
