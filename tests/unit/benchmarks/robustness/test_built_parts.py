"""Parts as built: what is displaced, and what stays."""

import numpy as np
import pytest

from benchmarks.robustness.all_kinds import BENCHES, KINDS
from benchmarks.robustness.built_parts import guide_3_percent_larger, guide_balls, nail_tolerances, ring_plates_nearer
from benchmarks.robustness.command import chosen_kinds
from shared.errors import InputError
from shared.geometry.lines import angle_between_rad
from tests.unit.simulation import rooms

SCENARIO = rooms.scenario()


def test_guide_balls_are_displaced_by_the_drawn_deviation() -> None:
    built, drawn = guide_balls(SCENARIO, np.random.default_rng(4))
    moved = built.parts.guide.balls.position_mm - SCENARIO.parts.guide.balls.position_mm
    assert np.std(moved) == pytest.approx(float(drawn["sd_mm"]), rel=0.3)
    assert built.parts.guide.holes == SCENARIO.parts.guide.holes


def test_a_larger_guide_is_larger_everywhere() -> None:
    built, _ = guide_3_percent_larger(SCENARIO, np.random.default_rng(4))
    assert np.allclose(built.parts.guide.balls.position_mm, 1.03 * SCENARIO.parts.guide.balls.position_mm)
    assert built.parts.guide.body[0].size_mm[0] == pytest.approx(1.03 * SCENARIO.parts.guide.body[0].size_mm[0])


def test_nearer_plates_move_the_balls_of_one_plate() -> None:
    built, drawn = ring_plates_nearer(SCENARIO, np.random.default_rng(4))
    before, after = SCENARIO.parts.ring.balls.position_mm, built.parts.ring.balls.position_mm
    low = before[:, 2] < -1.0
    assert np.allclose(after[low] - before[low], [0.0, 0.0, float(drawn["nearer_mm"])])
    assert np.array_equal(after[~low], before[~low])
    apart = [abs(one.plates[0].z_mm - one.plates[1].z_mm) for one in (SCENARIO.parts.ring, built.parts.ring)]
    assert apart[0] - apart[1] == pytest.approx(drawn["nearer_mm"])


def test_each_hole_of_a_nail_has_its_own_tolerance() -> None:
    built, _ = nail_tolerances(SCENARIO, np.random.default_rng(4))
    pairs = list(zip(SCENARIO.parts.nail.holes, built.parts.nail.holes, strict=True))
    shifts = [b.axis.point_mm - a.axis.point_mm for a, b in pairs]
    assert not np.allclose(shifts[0], shifts[1])
    assert all(0.0 < np.degrees(angle_between_rad(a.axis.direction, b.axis.direction)) < 1.5 for a, b in pairs)


def test_kinds_held_out_do_not_run_on_the_seeds_that_fit() -> None:
    for bench in BENCHES[:2]:
        fitting, judging = (chosen_kinds(bench, bench.names, seeds) for seeds in ("fit", "judged"))
        assert len(judging) == len(bench.names)
        assert 0 < len(fitting) < len(judging)
        assert chosen_kinds(bench, ["control"], "fit") == fitting[:1]
    with pytest.raises(InputError, match="held out of the seeds that fit: clamp; use --seeds judged"):
        chosen_kinds(BENCHES[1], ["clamp"], "fit")


def test_kinds_have_names_of_their_own() -> None:
    assert len(KINDS) == 1 + sum(len(bench.kinds) for bench in BENCHES)
