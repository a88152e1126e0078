"""Robust weights and trimming: known values, consistency of cost and weight, and outliers left out."""

import numpy as np
import pytest

from services.registration.core.estimation.robust import (
    cauchy_cost,
    cauchy_weight,
    inliers,
    robust_spread,
    robust_weight,
)


def test_a_residual_of_one_scale_counts_half() -> None:
    residual = np.array([0.0, -1.5, 1.5, 3.0])
    assert robust_weight(residual, 1.5) == pytest.approx([1.0, 0.5, 0.5, 0.2])


def test_the_weight_in_compiled_loops_is_that_of_arrays() -> None:
    for residual in (0.0, 0.3, 2.0, 50.0):
        assert cauchy_weight((residual / 1.5) ** 2) == pytest.approx(float(robust_weight(np.array(residual), 1.5)))


def test_the_cost_rises_with_the_square_of_a_residual_by_its_weight() -> None:
    at, step = 2.3, 1e-6
    slope = (cauchy_cost(at + step) - cauchy_cost(at - step)) / (2.0 * step)
    assert slope == pytest.approx(cauchy_weight(at), rel=1e-6)


@pytest.mark.parametrize("axes", [1, 2])
def test_the_spread_of_normal_errors_is_their_standard_deviation_despite_a_fifth_of_outliers(axes: int) -> None:
    error = np.random.default_rng(5).normal(0.0, 0.7, (20_000, axes))
    size = np.linalg.norm(error, axis=1)
    assert robust_spread(size, axes) == pytest.approx(0.7, rel=0.03)
    size[:4_000] = 100.0
    assert robust_spread(size, axes) < 1.5 * 0.7


def test_trimming_leaves_out_what_lies_beyond_the_limit_of_the_spread_of_those_in_use() -> None:
    residual = np.array([-0.2, 0.1, 0.15, -0.1, 5.0, 0.9])
    used = np.array([True, True, True, True, False, True])
    spread = 0.15 / 0.674490
    kept = inliers(residual, used, limit=4.0, least_spread=0.0)
    assert list(kept) == [abs(r) < 4.0 * spread for r in residual]
    assert not kept[4]


def test_a_least_spread_keeps_residuals_that_agree_by_chance() -> None:
    residual, used = np.array([0.0, 0.0, 0.0, 0.3]), np.ones(4, dtype=bool)
    assert not inliers(residual, used, limit=4.0, least_spread=0.0)[3]
    assert inliers(residual, used, limit=4.0, least_spread=0.1)[3]
