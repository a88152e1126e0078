"""Where a search converges, with costs that are written down."""

from typing import cast

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.background import BorderedFactor, DesignMatrix
from services.registration.core.nail.forward_model import ForwardModel, TracedTransmission
from services.registration.core.nail.least_squares import LinearSolution, NormalEquations, Solution
from services.registration.core.nail.parameters import Anchors, Parameter, prior_mean
from services.registration.core.nail.region import FitRegion
from services.registration.core.nail.tilt_ambiguity import converged_optimum
from shared.geometry.camera import PinholeCamera
from shared.geometry.parts import NailPart
from tests.unit.services.registration.rendered_case import rendered_parts
from tests.unit.services.registration.xray_scene import calibration

NOTHING: NDArray[np.float64] = np.zeros(0)


def optimum(cost: float, tilt_deg: float, least_cost: float | None = None) -> Solution:
    # costs and directions alone are compared: nothing is rendered, and nothing solved
    camera: PinholeCamera = calibration(640).camera
    nail: NailPart = rendered_parts().nail
    model = ForwardModel(cast("FitRegion", None), camera, Anchors(-15.0, 15.0), nail)
    parameters = prior_mean()
    parameters[: Parameter.PITCH_RAD] = (300.0, 320.0, 340.0, 320.0)
    parameters[Parameter.PITCH_RAD] = np.radians(tilt_deg)
    traced = TracedTransmission(parameters, NOTHING, NOTHING.astype(np.float32))
    design, factor = cast("DesignMatrix", None), cast("BorderedFactor", None)
    linear = LinearSolution(model, traced, NOTHING, NOTHING, NOTHING, NOTHING, cost, design, factor)
    equations = NormalEquations(NOTHING, NOTHING, NOTHING, NOTHING)
    return Solution(linear, equations, 1, converged=True, least_cost=cost if least_cost is None else least_cost)


class Landscape:
    """What a search meets, in turn."""

    def __init__(self, nearby: list[Solution], further: list[Solution]) -> None:
        self.nearby, self.further = iter(nearby), iter(further)

    def converge(self, start: Solution) -> tuple[Solution, float]:
        return converged_optimum(start, lambda _: next(self.nearby), lambda _: next(self.further))


def test_an_optimum_stays_and_competes_with_what_costs_least_nearby() -> None:
    start = optimum(100.0, 0.0)
    assert Landscape([optimum(150.0, 3.0)], []).converge(start) == (start, 150.0)


def test_an_abandoned_fit_counts_with_its_lower_bound() -> None:
    start = optimum(100.0, 0.0)
    assert Landscape([optimum(500.0, 3.0, least_cost=150.0)], []).converge(start) == (start, 150.0)


def test_an_end_on_a_slope_is_left_and_stays_a_competing_pose() -> None:
    end = optimum(88.0, 6.0)
    landscape = Landscape([optimum(95.0, 3.0), optimum(140.0, 9.0)], [end])
    assert landscape.converge(optimum(100.0, 0.0)) == (end, 100.0)


def test_an_end_that_was_left_beside_the_best_is_no_competing_pose() -> None:
    end = optimum(88.0, 1.0)
    landscape = Landscape([optimum(95.0, 3.0), optimum(140.0, 4.0)], [end])
    assert landscape.converge(optimum(100.0, 0.0)) == (end, 140.0)


def test_a_search_that_never_converges_has_no_margin() -> None:
    costs = [90.0, 80.0, 70.0, 60.0]
    landscape = Landscape([optimum(c + 5.0, c) for c in costs], [optimum(c, c) for c in costs])
    best, runner_up = landscape.converge(optimum(100.0, 0.0))
    assert best.cost == runner_up == 60.0
