"""A program's wall clock can be stepped while it runs; its monotonic clock cannot."""

import subprocess
import sys
from pathlib import Path

from benchmarks.common.places import ROOT
from benchmarks.faults.stepped_clock import ClockFile

# Prints both clocks for every line that it reads.
PROGRAM = """
import sys, time
from services.ui_api.handlers.clock import Clock
for _ in sys.stdin:
    print(time.time(), time.time_ns() / 1e9, Clock().unix_ns() / 1e9, time.monotonic(), flush=True)
"""


def test_a_step_reaches_the_wall_clock_alone(tmp_path: Path) -> None:
    (tmp_path / "shows_clocks.py").write_text(PROGRAM)
    clock = ClockFile(tmp_path / "clock")
    command = [sys.executable, "-m", "benchmarks.faults.stepped_clock", str(clock.path), "shows_clocks"]
    with subprocess.Popen(
        command,
        env={"PYTHONPATH": f"{ROOT}:{tmp_path}"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as program:
        assert program.stdin is not None
        assert program.stdout is not None
        shown = []
        for step_s in (0.0, -3600.0):
            clock.step_to(step_s)
            program.stdin.write("\n")
            program.stdin.flush()
            shown.append([float(word) for word in program.stdout.readline().split()])
        program.stdin.close()
    before, after = shown
    passed_s = after[3] - before[3]
    assert passed_s >= 0.0
    for wall_before, wall_after in zip(before[:3], after[:3], strict=True):
        assert abs(wall_after - wall_before + 3600.0 - passed_s) < 1.0
