"""Where a search converges, with costs that are written down; a bent nail is found bent, a straight one straight."""

from dataclasses import replace
from functools import cache
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.nail import image_fit as nail_fit
from services.registration.core.nail.background import BorderedFactor, DesignMatrix
from services.registration.core.nail.bent_nail import hole_directions, reflections
from services.registration.core.nail.fit import measure_nail
from services.registration.core.nail.forward_model import ForwardModel, TracedTransmission
from services.registration.core.nail.image_fit import NailFit, is_bent
from services.registration.core.nail.least_squares import LinearSolution, NormalEquations, Problem, Solution
from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.parameters import CURVATURE, Anchors, Parameter, prior_mean
from services.registration.core.nail.region import FitInput, FitRegion
from services.registration.core.nail.tilt_ambiguity import converged_optimum
from services.registration.core.tuning import BENT_NAIL, NAIL_PRIORS, TILT_SEARCH_STAGE
from shared.errors import Accepted
from shared.geometry.camera import PinholeCamera
from shared.geometry.lines import angle_between_rad, unit
from shared.geometry.parts import NailPart, hole_axis
from tests.unit.services.registration.rendered_case import (
    CAMERA_FROM_NAIL,
    SIZE_PX,
    pose_problem,
    rendered_parts,
    turned_nail,
)
from tests.unit.services.registration.xray_scene import Scene, calibration, render

NOTHING: NDArray[np.float64] = np.zeros(0)
PARTS = rendered_parts()


def optimum(cost: float, tilt_deg: float, least_cost: float | None = None) -> Solution:
    # costs and directions alone are compared: nothing is rendered, and nothing solved
    camera: PinholeCamera = calibration(640).camera
    nail: NailPart = PARTS.nail
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


@cache
def measured(curvature_per_m: tuple[float, float]) -> NailFit:
    """The fit of a nail with a curvature, by the part file of the straight one."""
    view, nail = calibration(SIZE_PX), PARTS.nail.bent(curvature_per_m)
    pixels = render(Scene(SIZE_PX, nail, CAMERA_FROM_NAIL), view, 5)
    found = measure_nail(FitInput(pixels, view, PARTS.nail, Occluders(None, PARTS.ring)), turned_nail((3.0, -1.5)))
    assert isinstance(found, Accepted)
    return found.value


@pytest.mark.parametrize("curvature", [(1.0, -1.5), pytest.param((-0.8, 1.0), marks=pytest.mark.long)])
def test_the_curvature_of_a_bent_nail_is_found(curvature: tuple[float, float], monkeypatch: pytest.MonkeyPatch) -> None:
    # parts of this simple drawing disagree: it has one energy and no penumbra
    monkeypatch.setattr(nail_fit, "BENT_NAIL", replace(BENT_NAIL, largest_error_ratio=np.inf))
    fit = measured.__wrapped__(curvature)
    off = np.array(fit.curvature_per_m) - curvature
    assert np.abs(off).max() < 0.3
    assert off @ np.linalg.solve(fit.errors.covariance_with_bend[6:, 6:], off) < 12.0
    found, true = PARTS.nail.bent(fit.curvature_per_m), PARTS.nail.bent(curvature)
    for hole in PARTS.nail.holes:
        axis = fit.camera_from_nail.directions(hole_axis(found, hole).direction)
        expected = CAMERA_FROM_NAIL.directions(hole_axis(true, hole).direction)
        assert np.degrees(angle_between_rad(axis, expected)) < 0.5


@pytest.mark.long
def test_where_parts_of_the_image_disagree_a_curvature_is_an_uncertainty_of_the_straight_nail() -> None:
    fit = measured((1.0, -1.5))
    assert fit.evidence.error_ratio > BENT_NAIL.largest_error_ratio
    assert fit.curvature_per_m == (0.0, 0.0)
    assert fit.errors.bend_sd_per_m == pytest.approx(np.hypot(1.0, 1.5), rel=0.2)


def test_a_straight_nail_stays_straight() -> None:
    fit = measured((0.0, 0.0))
    assert fit.curvature_per_m == (0.0, 0.0)
    assert fit.errors.bend_sd_per_m == NAIL_PRIORS.straightness_sd_per_m
    assert np.sqrt(np.diag(fit.errors.covariance_with_bend)[6:]) == pytest.approx(NAIL_PRIORS.straightness_sd_per_m)


@pytest.mark.parametrize("curvature", [(0.0, -0.5), (0.4, 0.4)])
def test_a_nail_is_bent_beyond_noise_and_makers_tolerance(curvature: tuple[float, float]) -> None:
    assert is_bent(np.array(curvature), 0.05**2 * np.eye(2))
    assert not is_bent(np.array(curvature), 1.0 * np.eye(2))
    assert not is_bent(0.2 * np.array(curvature), 0.05**2 * np.eye(2))


@cache
def tilted() -> tuple[Problem, NDArray[np.float64]]:
    """The nail's pose with 4° of pitch, no roll, and a curvature in the plane of nail and ray."""
    problem, parameters = pose_problem(TILT_SEARCH_STAGE, 3)
    start = problem.model.with_pose(parameters, CAMERA_FROM_NAIL)
    start[4:6] = np.radians(4.0), 0.0
    start[CURVATURE] = 0.0, 0.9
    return problem, start


@pytest.mark.parametrize(("which", "signs"), [(0, (-1.0, -1.0)), (1, (-1.0, 1.0)), (2, (1.0, -1.0))])
def test_reflections_reflect_the_tilts_of_both_holes_or_of_one(which: int, signs: tuple[float, float]) -> None:
    problem, start = tilted()
    reflected = list(reflections(problem, start))[which]
    before, after = along_tilts(problem, start), along_tilts(problem, reflected)
    proximal_first = np.argsort([hole.axis.point_mm[0] for hole in PARTS.nail.holes])
    assert after[proximal_first] == pytest.approx(before[proximal_first] * signs, abs=np.radians(0.1))


def along_tilts(problem: Problem, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """Tilts of the hole axes against their rays along the nail, rad, shape (H,)."""
    pose = problem.model.pose(parameters)
    rays = unit(np.stack([pose @ hole.axis.point_mm for hole in PARTS.nail.holes]))
    return np.asarray((hole_directions(problem, parameters) - rays) @ pose.rotation[:, 0])
