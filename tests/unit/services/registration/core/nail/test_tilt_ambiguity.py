"""Where a search comes to rest, with costs that are written down."""

from typing import cast

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.background import BorderedFactor
from services.registration.core.nail.forward_model import ForwardModel, TracedTransmission
from services.registration.core.nail.least_squares import LinearSolution, Sensitivity, Solution
from services.registration.core.nail.tilt_ambiguity import Optimum, converged_optimum

NOTHING: NDArray[np.float64] = np.zeros(0)


def optimum(cost: float, tilt_deg: float, least_cost: float | None = None) -> Optimum:
    # costs alone are compared: no scene is looked at, and nothing solved
    model, factor = cast("ForwardModel", None), cast("BorderedFactor", None)
    linear = LinearSolution(
        model,
        TracedTransmission(NOTHING, NOTHING, NOTHING.astype(np.float32)),
        NOTHING,
        NOTHING,
        NOTHING,
        NOTHING,
        cost,
        factor,
    )
    solution = Solution(
        linear,
        Sensitivity(NOTHING, NOTHING),
        NOTHING,
        1,
        converged=True,
        least_cost=cost if least_cost is None else least_cost,
    )
    tilt = np.radians(tilt_deg)
    return Optimum(solution, np.array([np.sin(tilt), 0.0, np.cos(tilt)]))


class Landscape:
    """What a search meets, in turn."""

    def __init__(self, nearby: list[Optimum], further: list[Optimum]) -> None:
        self.nearby, self.further = iter(nearby), iter(further)

    def rest(self, start: Optimum) -> tuple[Optimum, float]:
        return converged_optimum(start, lambda _: next(self.nearby), lambda _: next(self.further))


def test_an_optimum_stays_and_its_rival_is_what_costs_least_nearby() -> None:
    start = optimum(100.0, 0.0)
    assert Landscape([optimum(150.0, 3.0)], []).rest(start) == (start, 150.0)


def test_of_what_was_given_up_counts_what_it_can_hardly_fall_below() -> None:
    start = optimum(100.0, 0.0)
    assert Landscape([optimum(500.0, 3.0, least_cost=150.0)], []).rest(start) == (start, 150.0)


def test_an_end_on_a_slope_is_left_and_stays_a_rival() -> None:
    end = optimum(88.0, 6.0)
    landscape = Landscape([optimum(95.0, 3.0), optimum(140.0, 9.0)], [end])
    assert landscape.rest(optimum(100.0, 0.0)) == (end, 100.0)


def test_an_end_that_was_left_beside_the_best_is_no_rival() -> None:
    end = optimum(88.0, 1.0)
    landscape = Landscape([optimum(95.0, 3.0), optimum(140.0, 4.0)], [end])
    assert landscape.rest(optimum(100.0, 0.0)) == (end, 140.0)


def test_a_search_that_never_rests_has_no_margin() -> None:
    costs = [90.0, 80.0, 70.0, 60.0]
    landscape = Landscape([optimum(c + 5.0, c) for c in costs], [optimum(c, c) for c in costs])
    best, runner_up = landscape.rest(optimum(100.0, 0.0))
    assert best.solution.cost == runner_up == 60.0
