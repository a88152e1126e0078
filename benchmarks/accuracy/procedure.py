"""Twenty seeded procedures, from the mounted guide to the drilled holes; writes docs/benchmarks/procedure.md."""

import statistics
import sys
import time

from benchmarks.common.places import PAGES
from distalock.demo import DemoRequest, demonstrate
from distalock.procedure import Ending, Outcome

SEEDS = range(1, 21)
LEAST_DRILLED = 19
REPORT = PAGES / "procedure.md"


def main() -> int:
    """Run all seeds, write the report; 0 when at least 19 ended with both drills through and none beside its hole."""
    outcomes: dict[int, Outcome] = {}
    for seed in SEEDS:
        begun = time.monotonic()
        outcomes[seed] = demonstrate(DemoRequest(("--seed", str(seed))), lambda _: None)
        print(f"{_row(seed, outcomes[seed])}  ({time.monotonic() - begun:.0f} s)", flush=True)
    drilled = sum(o.ending is Ending.DRILLED for o in outcomes.values())
    missed = sum(o.ending is Ending.MISSED for o in outcomes.values())
    summary = _summary(outcomes)
    print(summary)
    REPORT.parent.mkdir(parents=True, exist_ok=True)
    REPORT.write_text(_report(outcomes, summary))
    return 0 if drilled >= LEAST_DRILLED and missed == 0 else 1


def _worst_offset_mm(outcome: Outcome, *, before: bool) -> float:
    errors = outcome.before if before else outcome.after
    return max(max(e.entry_offset_mm, e.exit_offset_mm) for e in errors)


def _row(seed: int, outcome: Outcome) -> str:
    before, after = _worst_offset_mm(outcome, before=True), _worst_offset_mm(outcome, before=False)
    angle = max(e.angle_deg for e in outcome.after)
    passed = sum(d.passed for d in outcome.drills)
    return (
        f"| {seed} | {outcome.ending} | {before:.2f} | {after:.2f} | {angle:.2f} | {outcome.shots} | {outcome.moves} "
        f"| {passed} of {len(outcome.drills)} | {outcome.why} |"
    )


def _summary(outcomes: dict[int, Outcome]) -> str:
    endings = [o.ending for o in outcomes.values()]
    drilled = [o for o in outcomes.values() if o.ending is Ending.DRILLED]
    counts = ", ".join(f"{endings.count(e)} {e}" for e in Ending)
    if not drilled:
        return f"{len(endings)} procedures: {counts}."
    offsets = [_worst_offset_mm(o, before=False) for o in drilled]
    angles = [max(e.angle_deg for e in o.after) for o in drilled]
    shots = statistics.median(o.shots for o in drilled)
    return (
        f"{len(endings)} procedures: {counts}. Of those drilled: true offset of the worse hole's axis "
        f"{statistics.median(offsets):.2f} mm median, {max(offsets):.2f} mm worst; angle "
        f"{statistics.median(angles):.2f}° median, {max(angles):.2f}° worst; shots {shots:.0f} median."
    )


def _report(outcomes: dict[int, Outcome], summary: str) -> str:
    head = (
        "# Whole procedures in the virtual operating room\n\n"
        "Made by `distalock bench procedure`. Offsets and angles: true errors of the guide's axes, the worse hole.\n\n"
        "| seed | ending | mm before | mm after | ° after | shots | moves | drills passed | refusal |\n"
        "|---|---|---|---|---|---|---|---|---|\n"
    )
    rows = "\n".join(_row(seed, outcome) for seed, outcome in outcomes.items())
    return f"{head}{rows}\n\n{summary}\n"


if __name__ == "__main__":
    sys.exit(main())
