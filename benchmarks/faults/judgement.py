"""What was seen while a fault lasted, held against what must hold: pure, a list of sentences on what did not."""

from collections.abc import Sequence
from typing import Final

from benchmarks.faults.declaration import (
    NOTICED_WITHIN_S,
    SAFE_WITHIN_MM,
    SAFE_WITHIN_S,
    Answers,
    Fault,
    InMotion,
    Readiness,
)
from benchmarks.faults.patient import NO_ANSWER, Step
from benchmarks.faults.watch import Motion

# A braked platform moves by nothing; its pose is computed in floating point.
_STILL_MM: Final = 1e-3


def wrong_in_motion(fault: Fault, step: Step, motion: Motion, *, was_locked: bool) -> list[str]:
    """Locked all the time at rest; in motion stopped within the limits where the fault must stop it."""
    if motion.safe_s is None:
        return ["the robot was not at rest and locked after 15 s"]
    if step is not Step.MOVING:
        return _wrong_at_rest(motion, was_locked=was_locked)
    if fault.in_motion is not InMotion.STOPS:
        return []
    wrong = []
    if motion.safe_s > SAFE_WITHIN_S:
        wrong.append(f"at rest and locked after {motion.safe_s:.2f} s (limit {SAFE_WITHIN_S:g} s)")
    if motion.travel_mm > SAFE_WITHIN_MM:
        wrong.append(f"went on for {motion.travel_mm:.2f} mm (limit {SAFE_WITHIN_MM:g} mm)")
    return wrong


def _wrong_at_rest(motion: Motion, *, was_locked: bool) -> list[str]:
    if not was_locked or motion.safe_s != 0.0:
        return [f"the robot, which was to stay locked, was not until {motion.safe_s or 0.0:.2f} s later"]
    if motion.travel_mm > _STILL_MM:
        return [f"the robot, which was locked, moved by {motion.travel_mm:.3f} mm"]
    return []


def wrong_in_readiness(fault: Fault, last_ready_s: float | None) -> list[str]:
    """`readyz` does not say yes while something of what it stands for is broken, once it must have noticed."""
    if fault.readiness is not Readiness.NEVER or last_ready_s is None or last_ready_s <= NOTICED_WITHIN_S:
        return []
    return [f"readyz said yes {last_ready_s:.1f} s after it had come (limit {NOTICED_WITHIN_S:g} s)"]


def wrong_in_answers(fault: Fault, said: Sequence[str]) -> list[str]:
    """The procedure goes on, or a sentence says why not; silence only where what would answer is gone."""
    match fault.answers:
        case Answers.GOES_ON if said:
            return [f"while it lasted, the procedure did not go on: {said[0]}"]
        case Answers.REFUSES:
            return [f"while it lasted: {sentence}" for sentence in said if NO_ANSWER in sentence]
        case _:
            return []
