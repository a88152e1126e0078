"""A program's wall clock can be stepped while it runs, and its children's; its monotonic clock cannot."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.faults.stepped_clock import ClockFile, stepped_environment

# Prints both clocks for every line that it reads.
PROGRAM = """
import sys, time
from services.ui_api.handlers.clock import Clock
for _ in sys.stdin:
    print(time.time(), time.time_ns() / 1e9, Clock().unix_ns() / 1e9, time.monotonic(), flush=True)
"""


PARENT = """
import subprocess, sys
sys.exit(subprocess.run([sys.executable, "-m", "shows_clocks"]).returncode)
"""


@pytest.mark.parametrize("module", ["shows_clocks", "has_a_child"])
def test_a_step_reaches_the_wall_clock_alone(tmp_path: Path, module: str) -> None:
    (tmp_path / "shows_clocks.py").write_text(PROGRAM)
    (tmp_path / "has_a_child.py").write_text(PARENT)
    clock = ClockFile(tmp_path / "clock")
    environment = stepped_environment(clock)
    with subprocess.Popen(
        [sys.executable, "-m", module],
        cwd=tmp_path,
        env={**os.environ, **environment},
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
