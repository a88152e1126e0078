"""The default ring is identified from any 60 % of its balls, in any rotation, mirrored or not, among other balls."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from services.imaging.core.identification import identify_ring
from services.imaging.core.joint_estimate import on_plane
from services.imaging.core.nominal import NominalGeometry
from shared.geometry.calibration import BallCandidates
from shared.geometry.parts import BallPattern, RingPart
from tests.unit.services.imaging.synthetic import SIZE_PX, Scene, default_ring, to_measured

Ints = NDArray[np.int64]


def candidates_of(
    scene: Scene, ring: RingPart, present: NDArray[np.bool_], others: int, rng: np.random.Generator
) -> tuple[BallCandidates, Ints]:
    """Discs as detection would find them, in random order, and the ball each one is (-1: none)."""
    centre = to_measured(scene, on_plane(ring.balls.position_mm, np.array(scene.source_mm)))[present]
    radius = NominalGeometry().ball_radii_px(ring)[present] * rng.uniform(0.75, 1.0, len(centre))
    centre = np.concatenate([centre + rng.normal(0.0, 0.1, centre.shape), rng.uniform(250, 770, (others, 2))])
    radius = np.concatenate([radius, rng.uniform(4.0, 7.5, others)])
    ball = np.concatenate([np.flatnonzero(present), np.full(others, -1)])
    order = rng.permutation(len(ball))
    if scene.mirrored:
        centre[:, 0] = SIZE_PX - 1 - centre[:, 0]
    ones = np.ones(len(ball))
    return BallCandidates(centre[order], radius[order], ones, 0.1 * ones, -np.ones(len(ball), np.int64)), ball[order]


def at_random(count: int, keep: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    present = np.zeros(count, bool)
    present[rng.permutation(count)[: int(np.ceil(keep * count))]] = True
    return present


def but_for_a_patch(ring: RingPart, keep: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """All but the balls nearest to a random place."""
    flat = ring.balls.position_mm[:, :2]
    distance = np.hypot(*(flat - rng.uniform(-60.0, 60.0, 2)).T)
    return np.asarray(distance >= np.sort(distance)[len(flat) - int(np.ceil(keep * len(flat)))])


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("seed", range(8))
def test_any_sixty_per_cent_in_any_rotation(seed: int, mirrored: bool) -> None:  # noqa: FBT001
    rng = np.random.default_rng([seed, mirrored])
    ring = default_ring()
    source = (*rng.uniform(-15.0, 15.0, 2), -rng.uniform(880.0, 1030.0))
    scene = Scene(source_mm=source, turn_deg=rng.uniform(0, 360), mirrored=mirrored, pincushion=rng.uniform(0.0, 0.08))
    present = at_random(120, 0.6, rng) if seed % 2 else but_for_a_patch(ring, 0.6, rng)
    candidates, truth = candidates_of(scene, ring, present, others=40, rng=rng)
    nominal = NominalGeometry(1000.0 * rng.uniform(0.91, 1.09), 0.235 * rng.uniform(0.91, 1.09))
    identity = identify_ring(candidates, ring, nominal)
    assert identity is not None
    assert identity.mirrored is mirrored
    named = np.flatnonzero(identity.candidate_of_ball >= 0)
    wrong = truth[identity.candidate_of_ball[named]] != named
    assert np.count_nonzero(wrong) <= 2  # another ball may lie within a shadow's breadth of a lost one
    assert np.count_nonzero(~wrong) >= 0.95 * np.count_nonzero(present)
    assert identity.runner_up < 0.5 * identity.identified


def test_a_pattern_that_looks_the_same_upside_down_has_an_equal_runner_up() -> None:
    rng = np.random.default_rng(11)
    half = default_ring().balls.position_mm[:40]
    position = np.concatenate([half, half * np.array([-1.0, -1.0, 1.0])])
    pattern = BallPattern(tuple(f"R{i}" for i in range(80)), position, np.full(80, 2.0))
    ring = replace(default_ring(), balls=pattern)
    candidates, _ = candidates_of(Scene(pincushion=0.0), ring, np.ones(80, bool), others=10, rng=rng)
    identity = identify_ring(candidates, ring, NominalGeometry())
    assert identity is not None
    assert identity.runner_up > 0.9 * identity.identified


def test_other_balls_alone_are_no_ring() -> None:
    rng = np.random.default_rng(12)
    candidates, _ = candidates_of(Scene(), default_ring(), np.zeros(120, bool), others=80, rng=rng)
    identity = identify_ring(candidates, default_ring(), NominalGeometry())
    assert identity is None or identity.identified < 24


def test_seven_discs_are_too_few_to_name() -> None:
    rng = np.random.default_rng(13)
    candidates, _ = candidates_of(Scene(), default_ring(), np.zeros(120, bool), others=7, rng=rng)
    assert identify_ring(candidates, default_ring(), NominalGeometry()) is None


def test_discs_too_far_apart_to_be_neighbours_are_no_ring() -> None:
    corners = np.stack(np.meshgrid([0.0, 1500.0, 3000.0], [0.0, 1500.0, 3000.0]), axis=-1).reshape(-1, 2)
    ones = np.ones(9)
    far_apart = BallCandidates(corners, 5.0 * ones, ones, 0.1 * ones, -np.ones(9, np.int64))
    assert identify_ring(far_apart, default_ring(), NominalGeometry()) is None
