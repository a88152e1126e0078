"""Fits that are given up, only when they end above what they may cost; solutions had again; derivatives at the end."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.nail.least_squares import (
    Problem,
    Solution,
    linear_solution_at,
    linear_solution_from,
    minimise,
    modelled_image,
    normal_equations_at,
    predicted_decrease,
    with_derivatives,
    with_hidden_filled,
)
from services.registration.core.nail.parameters import Parameter
from services.registration.core.tuning import TILT_SEARCH_STAGE
from tests.unit.services.registration.rendered_case import pose_problem

# samples within pixels leave the cost uneven: at one of these tilts it fell by 22 where derivatives had promised 5.5,
# at another by 720 where they had promised 250
_STEPS, _TOLERANCE, _A_LITTLE = 20, 0.5, 20.0
_TILTED_RAD = np.radians([(6.0, 0.0), (-6.0, 0.0), (0.0, 8.0), (5.0, -9.0)])


@cache
def case() -> tuple[Problem, NDArray[np.float64]]:
    return pose_problem(TILT_SEARCH_STAGE, 3)


def fitted(tilt: int, cost_limit: float = np.inf) -> Solution:
    """The fit that begins with the nail tilted by one of the tilts."""
    problem, start = case()[0], case()[1].copy()
    start[[Parameter.PITCH_RAD, Parameter.ROLL_RAD]] += _TILTED_RAD[tilt]
    return minimise(problem, start, _STEPS, _TOLERANCE, cost_limit)


@cache
def ended(tilt: int) -> Solution:
    return fitted(tilt)


@pytest.mark.parametrize("tilt", range(len(_TILTED_RAD)))
def test_a_fit_is_abandoned_only_when_it_ends_above_its_limit(tilt: int) -> None:
    allowed = 0.5 * ended(tilt).cost
    abandoned = fitted(tilt, allowed)
    assert allowed < abandoned.least_cost <= ended(tilt).cost
    assert abandoned.steps < ended(tilt).steps
    assert not abandoned.converged


@pytest.mark.parametrize("tilt", range(len(_TILTED_RAD)))
def test_a_fit_that_ends_a_little_below_its_limit_is_followed(tilt: int) -> None:
    followed = fitted(tilt, ended(tilt).cost + _A_LITTLE)
    assert followed.cost == followed.least_cost == ended(tilt).cost
    assert followed.converged


def test_a_solution_had_again_with_other_weights_is_that_of_the_traced_rays() -> None:
    problem, start = case()
    others = replace(problem, weight=problem.weight * np.linspace(0.5, 2.0, len(problem.weight)))
    again, anew = linear_solution_from(others, linear_solution_at(problem, start)), linear_solution_at(others, start)
    assert again.cost == anew.cost != linear_solution_at(problem, start).cost
    assert np.array_equal(again.residual, anew.residual)


def test_a_solution_cannot_be_had_again_in_another_scene() -> None:
    problem, start = case()
    elsewhere = replace(problem, model=replace(problem.model))
    with pytest.raises(ValueError, match="whitening changes the model"):
        linear_solution_from(elsewhere, linear_solution_at(problem, start))


def test_derivatives_at_the_end_are_those_of_the_end() -> None:
    """A fit of one step ends far from where its derivatives were taken, and nobody has asked for others yet."""
    problem, start = case()[0], case()[1].copy()
    start[[Parameter.PITCH_RAD, Parameter.ROLL_RAD]] += _TILTED_RAD[0]
    stopped = minimise(problem, start, 1, _TOLERANCE)
    assert np.array_equal(stopped.equations.at, start)
    with_them = with_derivatives(problem, stopped)
    there = normal_equations_at(problem, stopped.linear)
    assert np.array_equal(with_them.equations.at, stopped.parameters)
    assert with_them.equations.matrix == pytest.approx(there.matrix)
    assert with_derivatives(problem, with_them) is with_them


def test_derivatives_from_beyond_the_chamfers_end_are_taken_anew() -> None:
    """Without a chamfer nothing changes by it: a fit that took that over would hold no tilt for uncertain by it."""
    problem, start = case()[0], case()[1].copy()
    free = problem.free.copy()
    free[Parameter.CHAMFER_DEVIATIONS] = True
    problem = replace(problem, free=free)
    place = int(np.count_nonzero(free[: Parameter.CHAMFER_DEVIATIONS]))
    without, left = start.copy(), start.copy()
    without[Parameter.CHAMFER_DEVIATIONS], left[Parameter.CHAMFER_DEVIATIONS] = -1.02, -0.98
    none, some = (normal_equations_at(problem, linear_solution_at(problem, at)) for at in (without, left))
    assert np.all(none.jacobian[:, place] == 0.0)
    linear = linear_solution_at(problem, left)
    stale = Solution(linear, none, 1, True, linear.cost)
    renewed = with_derivatives(problem, stale)
    assert renewed.equations.jacobian == pytest.approx(some.jacobian)
    assert np.any(renewed.equations.jacobian[:, place] != 0.0)


def test_close_to_the_optimum_the_predicted_decrease_is_what_the_fit_gains() -> None:
    problem, optimum = case()[0], ended(0).parameters
    near = optimum.copy()
    near[[Parameter.FIRST_X_PX, Parameter.SECOND_Y_PX]] += 0.05
    here = linear_solution_at(problem, near)
    gained = here.cost - minimise(problem, near, _STEPS, 1e-3).cost
    assert predicted_decrease(problem, here) == pytest.approx(gained, rel=0.3)


def test_hidden_pixels_show_what_is_modelled_and_others_what_was_measured() -> None:
    problem = case()[0]
    region = problem.model.region
    hidden = np.zeros(region.shape, dtype=bool)
    rows, columns = (side // 2 for side in region.shape)
    hidden[rows - 2 : rows + 2, columns - 2 : columns + 2] = True
    spoiled = replace(region, hidden=hidden, grey=np.where(hidden, 3.0, region.grey))
    solution = ended(0).linear
    filled, again = with_hidden_filled(replace(problem, model=replace(problem.model, region=spoiled)), solution)
    assert again.model is filled.model
    assert np.array_equal(filled.model.region.grey[~hidden], region.grey[~hidden])
    modelled = modelled_image(problem.model, solution)[hidden]
    assert np.array_equal(filled.model.region.grey[hidden], modelled)
    assert modelled == pytest.approx(region.grey[hidden], abs=0.15)


def test_without_hidden_pixels_nothing_is_made_anew() -> None:
    problem, solution = case()[0], ended(0).linear
    assert with_hidden_filled(problem, solution) == (problem, solution)
