"""Displaced balls: their spread is estimated from the residuals, and the pose's covariance grows with it."""

from importlib.resources import files

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.estimation.image_points import Correspondences, refine_pose
from services.registration.core.estimation.shared_image_errors import fit_with_shared_errors
from services.registration.core.guide.as_built import (
    FocalLength,
    beside_px2,
    displacement_sd_mm,
    focal_length_of,
    px_per_mm,
)
from services.registration.core.tuning import GUIDE_AS_BUILT
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Guide
from shared.geometry.transform import Transform
from shared.parts.files import guide_from_json

CAMERA = PinholeCamera(np.array([[4400.0, 0.0, 512.0], [0.0, 4400.0, 512.0], [0.0, 0.0, 1.0]]))
POSE: Transform[Camera, Guide] = Transform.from_rotation_translation(np.eye(3), [5.0, -3.0, 640.0])
MEASURED_PX = 0.06
BODY_MM = guide_from_json(files("shared.parts").joinpath("catalogue/guide-28.json").read_bytes()).balls.position_mm
NOTHING_SHARED = np.zeros((len(BODY_MM), len(BODY_MM)))


def seen_of(true_mm: NDArray[np.float64], rng: np.random.Generator) -> Correspondences:
    """Balls that lie elsewhere than their file says, as measured."""
    px = CAMERA.project(POSE.points(true_mm)) + rng.normal(0.0, MEASURED_PX, (len(BODY_MM), 2))
    return Correspondences(BODY_MM, px, np.full(len(BODY_MM), MEASURED_PX))


def spread_mm(seen: Correspondences) -> float:
    return displacement_sd_mm(CAMERA, refine_pose(CAMERA, POSE, seen), seen, NOTHING_SHARED)


@pytest.mark.parametrize("true_mm", [0.05, 0.1, 0.2])
def test_errors_with_displaced_balls_are_as_large_as_predicted(true_mm: float) -> None:
    rng, found, normalised = np.random.default_rng(41), [], []
    for _ in range(60):
        seen = seen_of(BODY_MM + rng.normal(0.0, true_mm, BODY_MM.shape), rng)
        found.append(spread_mm(seen))
        spread_px = found[-1] * px_per_mm(CAMERA, POSE, BODY_MM)
        wider = Correspondences(BODY_MM, seen.ideal_px, np.hypot(MEASURED_PX, spread_px))
        fit = fit_with_shared_errors(CAMERA, refine_pose(CAMERA, POSE, wider), wider, NOTHING_SHARED)
        error = fit.mean.motion_to(POSE)
        normalised.append(float(error @ np.linalg.solve(fit.covariance, error)) / 6.0)
    assert np.median(found) == pytest.approx(true_mm, rel=0.15)
    assert 0.8 < np.sqrt(np.mean(normalised)) < 1.25


def test_a_guide_as_filed_has_no_spread() -> None:
    rng = np.random.default_rng(42)
    assert [spread_mm(seen_of(BODY_MM, rng)) for _ in range(20)] == [0.0] * 20


def focal_length(true_mm: NDArray[np.float64], rng: np.random.Generator) -> FocalLength:
    seen = seen_of(true_mm, rng)
    return focal_length_of(CAMERA, refine_pose(CAMERA, POSE, seen), seen, NOTHING_SHARED)


def test_planes_at_another_distance_show_as_another_focal_length_and_another_scale_does_not() -> None:
    rng = np.random.default_rng(43)
    apart = focal_length(BODY_MM * np.array([1.0, 1.0, 1.1]), rng)
    assert apart.excess == pytest.approx(-0.1, abs=0.02)
    assert apart.explained > 0.8
    assert abs(focal_length(BODY_MM * 1.03, rng).excess) < 3.0 * apart.standard_deviation
    assert spread_mm(seen_of(BODY_MM * 1.03, rng)) == 0.0


def test_the_focal_length_of_the_balls_errs_as_predicted() -> None:
    rng = np.random.default_rng(44)
    sigmas = [focal_length(BODY_MM, rng).sigmas(0.0) for _ in range(100)]
    assert 0.85 < np.std(sigmas) < 1.15


def test_a_conflict_grows_from_little_where_both_agree_to_the_difference() -> None:
    assert FocalLength(0.1, 0.004, 0.5).conflict(0.003) == pytest.approx(0.1, rel=0.06)
    grown = [FocalLength(excess, 0.004, 0.5).conflict(0.003) for excess in (0.0, 0.005, 0.01, 0.015, 0.02)]
    assert grown == sorted(grown)
    assert grown[0] < 0.3 * 0.005
    assert FocalLength(-0.01, 0.004, 0.5).conflict(0.003) == grown[2]


def test_a_conflict_is_the_second_moment_of_the_focal_lengths_error() -> None:
    rng, (own_sd, draws) = np.random.default_rng(7), (0.007, 1_000_000)
    other = rng.random(draws) < GUIDE_AS_BUILT.other_ring
    error = np.where(other, rng.normal(0.0, GUIDE_AS_BUILT.other_ring_sd, draws), 0.0)
    observed = error + rng.normal(0.0, own_sd, draws)
    for excess in (0.0, 0.01, 0.02):
        alike = np.abs(observed - excess) < 0.0005
        expected = np.sqrt(np.mean(error[alike] ** 2))
        assert FocalLength(excess, own_sd, 0.5).conflict(0.0) == pytest.approx(expected, rel=0.05)


def test_balls_in_one_plane_across_the_beam_give_no_focal_length() -> None:
    flat = Correspondences(
        BODY_MM * [1.0, 1.0, 0.0], CAMERA.project(POSE.points(BODY_MM * [1.0, 1.0, 0.0])), np.ones(28)
    )
    found = focal_length_of(CAMERA, POSE, flat, NOTHING_SHARED)
    assert (found.excess, found.standard_deviation) == (0.0, np.inf)
    not_checked = np.sqrt(GUIDE_AS_BUILT.other_ring) * GUIDE_AS_BUILT.other_ring_sd
    assert found.conflict(0.01) == pytest.approx(not_checked)


def test_discs_beside_balls_are_those_of_balls_that_no_fit_used() -> None:
    predicted = np.array([[0.0, 0.0], [20.0, 0.0], [40.0, 0.0], [60.0, 0.0], [80.0, 0.0]])
    used = np.array([False, True, False, False, False])
    disc = np.array([[3.0, 4.0], [0.0, -6.0], [22.0, 0.0], [40.0, 0.4], [60.0, 9.0]])
    # of the first ball's two the nearer one; the second is used, the third's may be in its place, the fourth's is too
    # far away, the fifth has none
    found = beside_px2(predicted, used, disc, np.full(5, 0.1), reach_px=8.0)
    assert found.tolist() == [25.0]
    assert len(beside_px2(predicted, used, np.empty((0, 2)), np.empty(0), reach_px=8.0)) == 0
