"""The console draws the hexapod with kinematics of its own: both sides are held to the same numbers."""

import json
from typing import Final

import numpy as np

from shared.geometry.hexapod import PlatformPose, leg_lengths_mm
from shared.parts.catalogue import DEFAULT_HEXAPOD
from shared.parts.hexapod_file import hexapod_from_json
from tools.console_fixture import FIXTURE, fixture_text

_TOLERANCE_MM: Final = 1e-6


def test_the_consoles_numbers_are_those_of_the_kinematics() -> None:
    """Its own `hexapod.test.ts` compares them with what the page computes."""
    kept = json.loads(FIXTURE.read_text(encoding="utf-8"))
    assert kept["hexapod"] == json.loads(DEFAULT_HEXAPOD.read_text(encoding="utf-8"))
    hexapod = hexapod_from_json(DEFAULT_HEXAPOD.read_bytes(), "default")
    lengths = [
        leg_lengths_mm(hexapod, PlatformPose(**case["pose"]).as_array(), np.array(case["pivot_mm"]))
        for case in kept["cases"]
    ]
    np.testing.assert_allclose([case["leg_lengths_mm"] for case in kept["cases"]], lengths, atol=_TOLERANCE_MM)
    assert FIXTURE.read_text(encoding="utf-8") == fixture_text()


def test_the_numbers_can_tell_a_wrong_order_of_rotations_and_a_wrong_pivot() -> None:
    cases = json.loads(FIXTURE.read_text(encoding="utf-8"))["cases"]
    turned = [c for c in cases if min(abs(c["pose"][axis]) for axis in ("u_deg", "v_deg", "w_deg")) > 1.0]
    assert len(turned) >= 6
    assert len({tuple(c["pivot_mm"]) for c in turned}) == 3
