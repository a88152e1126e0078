"""Random sequences of faults, commands and events on the whole robot service; writes docs/benchmarks/robot-faults.md.

After every tenth of a second of the sequence, and at its end, the truth of the virtual robot is held against what the
service was permitted to do and says.
"""

import sys
from collections import Counter
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.robot_rig import Rig, SentCommand, random_target
from services.robot.core.motion import MotionState
from services.robot.core.supervision import PATH_TOLERANCE, distance_from_path
from shared.errors import NoReply
from shared.geometry.hexapod import PlatformPose
from shared.messages.base import encode
from shared.messages.robot import CommandReply
from simulation.controller.faults import LINE_FAULTS, Fault
from simulation.controller.hexapod_model import SLIP_MM

SEQUENCES = 10_000
FIRST_SEED = 1
EVENTS = 14
PROCESSES = 2
TARGET_SIZE = 0.3
STILL_MM = 1e-6
TICKS_TO_SETTLE = 25
# A controller that does not hear cannot be told to stop: while these last, a move goes on to its target.
UNHEARD = LINE_FAULTS | {Fault.POWER_CYCLE}
REPORT = Path(__file__).resolve().parent.parent / "docs" / "benchmarks" / "robot-faults.md"


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
        elif distance_from_path(*self.way, pose).exceeds(PATH_TOLERANCE):
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


# Events


def _sensible_step(w: Watched) -> None:
    """What somebody at a console would do next."""
    rig = w.rig
    match rig.status.state:
        case MotionState.STOPPED:
            w.ask(rig.plain("acknowledge_stop"))
        case MotionState.UNREFERENCED:
            w.ask(rig.plain("reference"))
        case MotionState.FAULT:
            w.ask(rig.plain("reset"))
        case MotionState.LOCKED:
            _plan(w)
            _move(w)
        case _:
            w.tick()


def _plan(w: Watched) -> None:
    w.plan_target = random_target(w.rig.random, TARGET_SIZE)
    w.plan_json = w.rig.publish_plan(w.plan_target)


def _move(w: Watched) -> None:
    if w.plan_json is None or w.plan_target is None:
        return
    start = w.rig.virtual.snapshot().pose
    reply = w.ask(w.rig.move(w.plan_json))
    if reply is not None and reply.verdict == "accepted":
        w.accepted.append(w.plan_target)
        w.way = (start, w.plan_target)
        w.unheard_since_move = bool(w.faults & UNHEARD)


def _move_unapproved(w: Watched) -> None:
    target = random_target(w.rig.random, TARGET_SIZE)
    unpublished = w.rig.publish_plan(target) if w.rig.random.random() < 0.5 else _unpublished(w, target)
    reply = w.ask(w.rig.move(unpublished, approved_sha256="e" * 64))
    if reply is not None and reply.verdict == "accepted":
        w.wrong.append(f"a move was accepted without approval; after: {', '.join(w.done)}")


def _unpublished(w: Watched, target: PlatformPose) -> bytes:
    return encode(w.rig.plan_to(target))


def _repeat_old(w: Watched) -> None:
    if w.old_commands:
        try:
            w.rig.ask(w.rig.random.choice(w.old_commands))
        except NoReply:
            return


def _stop(w: Watched) -> None:
    try:
        w.rig.stop()
    except NoReply:
        return


def _inject(w: Watched) -> None:
    fault = w.rig.random.choice(list(Fault))
    w.done.append(f"+{fault.value}")
    w.faults.add(fault)
    w.rig.virtual.inject(fault)


def _mend(w: Watched) -> None:
    for fault in sorted(w.faults)[: w.rig.random.randint(1, 3)]:
        w.faults.discard(fault)
        w.rig.virtual.clear(fault)
        w.unheard_since_move |= fault in UNHEARD


def _gateway_pauses(w: Watched) -> None:
    w.rig.gateway_alive = not w.rig.gateway_alive


def _gateway_restarts(w: Watched) -> None:
    w.rig.gateway_boot += "1"
    w.rig.give_signs_of_life()


def _registration_pauses(w: Watched) -> None:
    w.rig.registration_alive = not w.rig.registration_alive


def _new_image(w: Watched) -> None:
    w.rig.begin_epoch()


def _case_changes(w: Watched) -> None:
    w.rig.case_revision += 1
    w.rig.open_case()


def _link_flips(w: Watched) -> None:
    w.rig.bus.up = not w.rig.bus.up


def _stop_and_time(w: Watched) -> None:
    _stop(w)
    w.tick(w.rig.random.uniform(0.0, 0.5))


EVENTS_BY_WEIGHT: dict[Callable[[Watched], None], int] = {
    _sensible_step: 45,
    _inject: 14,
    _mend: 12,
    _repeat_old: 6,
    _move_unapproved: 5,
    _move: 4,
    _plan: 2,
    _stop: 3,
    _stop_and_time: 2,
    _gateway_pauses: 4,
    _gateway_restarts: 1,
    _registration_pauses: 3,
    _new_image: 2,
    _case_changes: 1,
    _link_flips: 3,
}


@dataclass(frozen=True, slots=True)
class SequenceResult:
    """What came of one sequence: violations, moves that began and were reached, and the last state."""

    seed: int
    wrong: tuple[str, ...]
    moves: int
    reached: int
    final_state: str


def run_sequence(seed: int) -> SequenceResult:
    """Play one sequence and look at its end, with everything mended: locked, at rest, known."""
    w = Watched(Rig(seed))
    reached = 0
    w.rig.make_ready()
    w.last_pose = w.rig.virtual.snapshot().pose
    events, weights = list(EVENTS_BY_WEIGHT), list(EVENTS_BY_WEIGHT.values())
    for _ in range(EVENTS):
        (event,) = w.rig.random.choices(events, weights)
        w.done.append(event.__name__.strip("_"))
        event(w)
        for _ in range(w.rig.random.randint(1, 2)):
            w.tick(w.rig.random.choice((0.02, 0.1, 0.1, 0.18)))
        reached += w.rig.state.outcome == "reached" and w.rig.state.deviation_mm is not None
    _settle(w)
    return SequenceResult(seed, tuple(w.wrong), len(w.rig.sent_moves), reached, w.rig.state.state.value)


def _settle(w: Watched) -> None:
    w.done.append("the end")
    for fault in tuple(w.faults):
        w.rig.virtual.clear(fault)
    w.unheard_since_move = True
    w.faults.clear()
    w.rig.bus.up = w.rig.gateway_alive = True
    w.rig.stop()
    for _ in range(TICKS_TO_SETTLE):
        w.tick()
        if w.rig.state.locked and w.rig.status.state in (MotionState.STOPPED, MotionState.FAULT):
            break
    truth = w.rig.virtual.snapshot()
    if truth.servo_on or not truth.brake_on or truth.moving:
        w.wrong.append(f"not locked at the end; after: {', '.join(w.done)}")
    if w.rig.status.state not in (MotionState.STOPPED, MotionState.FAULT):
        w.wrong.append(f"the state at the end is '{w.rig.status.state}'; after: {', '.join(w.done)}")
    w.rig.leave()


def results(seeds: Iterable[int]) -> list[SequenceResult]:
    """Play sequences one after another."""
    return [run_sequence(seed) for seed in seeds]


def main() -> int:
    """Play all sequences, write the report; 0 when nothing went wrong."""
    played: list[SequenceResult] = []
    with ProcessPoolExecutor(PROCESSES) as pool:
        for result in pool.map(run_sequence, range(FIRST_SEED, FIRST_SEED + SEQUENCES), chunksize=25):
            played.append(result)
            for what in result.wrong:
                print(f"seed {result.seed}: {what}", flush=True)
    report = _report(played)
    print(report)
    REPORT.write_text(report)
    return 0 if not any(r.wrong for r in played) else 1


def _report(played: list[SequenceResult]) -> str:
    endings = ", ".join(f"{count} `{state}`" for state, count in sorted(Counter(r.final_state for r in played).items()))
    wrong = sum(bool(r.wrong) for r in played)
    return (
        "# Random faults on the robot service\n\n"
        f"Made by `distalock bench robot_faults`: {len(played)} sequences of {EVENTS} random events from a ready "
        "robot: "
        "every fault of the\nvirtual controller, commands right, wrong, unapproved and repeated, pauses and restarts "
        "of "
        "gateway and registration,\nnew images, a cut link. Service, guard, drive and "
        "driver are the product's, down to the bytes.\n\n"
        "| what | number |\n|---|---|\n"
        "| sequences with a motion that no accepted command had asked for, beside its way, twice, or after a stop; "
        "with a "
        " platform held by neither brake nor servo at any time; with a false `locked`; not locked and at rest at "
        f"the end; or in a state other than `stopped` or `fault` then | {wrong} |\n"
        f"| moves begun | {sum(r.moves for r in played)} |\n"
        f"| states at the end, after a stop | {endings} |\n"
    )


if __name__ == "__main__":
    sys.exit(main())
