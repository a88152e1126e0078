"""The figures of the bus's benchmark, from latencies that are known."""

import subprocess
from typing import cast

import pytest

from benchmarks.bus.bus import COMMAND_LIMIT, FRAME_LIMIT, Bus, commands_of, frames_of, page, ratio
from benchmarks.bus.ends import KINDS, Kind, NearEnd

NOBODY = cast("NearEnd", None)  # figures ask nobody
NO_PROCESS = cast("subprocess.Popen[str]", None)


def buses() -> dict[Kind, Bus]:
    """Two rounds: in the second the machine was ten times as slow, for all."""
    factors: dict[Kind, float] = dict(zip(KINDS, (1.0, 1.1, 1.2), strict=True))
    return {
        kind: Bus(kind, NOBODY, NO_PROCESS, [[f * 0.001] * 3, [f * 0.01] * 3], [[f * 0.0002] * 5, [f * 0.002] * 5])
        for kind, f in factors.items()
    }


def test_a_slow_round_does_not_change_a_ratio() -> None:
    measured = buses()
    measured["protected"].frames_s[0][0] = 5.0  # nor does one frame that came late
    assert ratio(measured, "protected", frames_of) == pytest.approx(1.2)
    assert ratio(measured, "plain", commands_of) == pytest.approx(1.1)


def test_the_page_states_what_was_measured_and_the_limits() -> None:
    text = page(buses())
    assert "2 rounds of 45 frames of 2 MB" in text
    assert "| the bus: mutual TLS, access control | 6.60 ms | 12.00 ms | 6 of 90 | 1.20 |" in text
    assert f"| {FRAME_LIMIT:g} | | | {COMMAND_LIMIT:g} |" in text
