"""Random sequences of faults, commands and events on the whole robot service; writes docs/benchmarks/robot-faults.md.

After every tenth of a second of the sequence, and at its end, the truth of the virtual robot is held against what the
service was permitted to do and says.
"""

import sys
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

from benchmarks.common.places import PAGES
from benchmarks.robot.events import EVENTS_BY_WEIGHT
from benchmarks.robot.rig import Rig
from benchmarks.robot.watched import Watched
from shared.robot_states import MotionState

SEQUENCES = 10_000
FIRST_SEED = 1
EVENTS = 14
PROCESSES = 2
TICKS_TO_SETTLE = 25
REPORT = PAGES / "robot-faults.md"


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
        "platform held by neither brake nor servo at any time; with a false `locked`; not locked and at rest at "
        f"the end; or in a state other than `stopped` or `fault` then | {wrong} |\n"
        f"| moves begun | {sum(r.moves for r in played)} |\n"
        f"| states at the end, after a stop | {endings} |\n"
    )


if __name__ == "__main__":
    sys.exit(main())
