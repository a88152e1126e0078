"""A nail that is bent is found bent, a straight one stays straight; the starts of the search are reflections."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.nail.bend_search import hole_directions, reflections
from services.registration.core.nail.fit import NailFit, is_bent, measure_nail
from services.registration.core.nail.least_squares import Problem
from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.parameters import CURVATURE
from services.registration.core.nail.region import FitInput
from services.registration.core.tuning import NAIL_PRIORS, TILT_SEARCH_STAGE
from shared.errors import Accepted
from shared.geometry.lines import angle_between_rad, unit
from shared.geometry.parts import hole_axis
from tests.unit.services.registration.rendered_case import (
    CAMERA_FROM_NAIL,
    SIZE_PX,
    pose_problem,
    rendered_parts,
    turned_nail,
)
from tests.unit.services.registration.xray_scene import Scene, calibration, render

PARTS = rendered_parts()


@cache
def measured(curvature_per_m: tuple[float, float]) -> NailFit:
    """The fit of a nail with a curvature, by the part file of the straight one."""
    view, nail = calibration(SIZE_PX), PARTS.nail.bent(curvature_per_m)
    pixels = render(Scene(SIZE_PX, nail, CAMERA_FROM_NAIL), view, 5)
    found = measure_nail(FitInput(pixels, view, PARTS.nail, Occluders(None, PARTS.ring)), turned_nail((3.0, -1.5)))
    assert isinstance(found, Accepted)
    return found.value


@pytest.mark.parametrize("curvature", [(1.0, -1.5), (-0.8, 1.0)])
def test_the_curvature_of_a_bent_nail_is_found(curvature: tuple[float, float]) -> None:
    fit = measured(curvature)
    off = np.array(fit.curvature_per_m) - curvature
    assert np.abs(off).max() < 0.3
    assert off @ np.linalg.solve(fit.errors.covariance_with_bend[6:, 6:], off) < 12.0
    found, true = PARTS.nail.bent(fit.curvature_per_m), PARTS.nail.bent(curvature)
    for hole in PARTS.nail.holes:
        axis = fit.camera_from_nail.directions(hole_axis(found, hole).direction)
        expected = CAMERA_FROM_NAIL.directions(hole_axis(true, hole).direction)
        assert np.degrees(angle_between_rad(axis, expected)) < 0.5


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
