"""Settings of a measurement by the pitch of the pixels, and radii of the ring's balls."""

import numpy as np
import pytest

from services.imaging.core.ball_measurement import found_radii_px, measurement_settings, usual_radii_px
from shared.geometry.calibration import NOT_OF_THE_RING, BallCandidates
from tests.unit.services.imaging.synthetic import default_ring


def test_finer_pixels_need_wider_surroundings() -> None:
    usual, fine = measurement_settings(0.094, 0.235), measurement_settings(0.094, 0.1175)
    assert fine.reach_px == pytest.approx(2.0 * usual.reach_px)
    assert fine.blur_px == pytest.approx(2.0 * usual.blur_px)
    assert usual.drift_px == 0.4
    assert fine.drift_px == pytest.approx(0.8)


def test_coarser_pixels_do_not_need_narrower_ones() -> None:
    coarse, usual = measurement_settings(0.094, 0.4), measurement_settings(0.094, 0.235)
    assert (coarse.reach_px, coarse.blur_px, coarse.drift_px) == (usual.reach_px, usual.blur_px, usual.drift_px)


def test_the_least_contrast_of_a_ball_can_be_chosen() -> None:
    usual, clear = measurement_settings(0.094, 0.2), measurement_settings(0.094, 0.2, 8.0)
    assert usual.contrast_to_sd < clear.contrast_to_sd == 8.0


RING = default_ring()
SIZES_MM = np.unique(RING.balls.diameter_mm)


def discs(index: list[int], radius_px: list[float]) -> BallCandidates:
    count = len(index)
    ones = np.ones(count)
    return BallCandidates(np.zeros((count, 2)), np.array(radius_px), ones, ones, np.array(index, dtype=np.int64))


def balls_of(size_mm: float, count: int) -> list[int]:
    return [int(ball) for ball in np.flatnonzero(RING.balls.diameter_mm == size_mm)[:count]]


def test_radii_are_those_of_the_discs_that_are_the_rings() -> None:
    found = found_radii_px(discs([7, NOT_OF_THE_RING, 3], [5.0, 99.0, 4.0]), RING)
    assert found[7] == 5.0
    assert found[3] == 4.0
    assert np.count_nonzero(np.isfinite(found)) == 2


def test_usual_radius_is_the_middle_one_of_each_size() -> None:
    small, large = balls_of(SIZES_MM[0], 3), balls_of(SIZES_MM[-1], 3)
    found = found_radii_px(discs(small + large, [4.0, 4.2, 9.9, 6.0, 6.1, 0.1]), RING)
    usual = usual_radii_px(found, RING)
    assert usual[RING.balls.diameter_mm == SIZES_MM[0]] == pytest.approx(4.2)
    assert usual[RING.balls.diameter_mm == SIZES_MM[-1]] == pytest.approx(6.0)


def test_a_size_of_which_none_is_found_takes_what_is_given_else_the_middle_of_all() -> None:
    found = found_radii_px(discs(balls_of(SIZES_MM[0], 3), [4.0, 4.2, 4.4]), RING)
    other = RING.balls.diameter_mm != SIZES_MM[0]
    assert other.any()
    assert usual_radii_px(found, RING)[other] == pytest.approx(4.2)
    given = np.arange(float(len(RING.balls)))
    usual = usual_radii_px(found, RING, given)
    assert usual[other] == pytest.approx(given[other])
    assert usual[~other] == pytest.approx(4.2)
    assert (given == np.arange(len(RING.balls))).all()
