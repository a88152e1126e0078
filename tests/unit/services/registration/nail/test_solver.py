"""Fits that are given up: only when they end above what they may cost, and by no more than they end there."""

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.nail.capture import POSE_ONLY
from services.registration.core.nail.equations import Problem
from services.registration.core.nail.occluders import Occluders, PlacedGuide
from services.registration.core.nail.pose import POSE_SIZE, parameters_from_pose
from services.registration.core.nail.solver import Solution, minimise
from services.registration.core.nail.stages import Detail, Given, problem_for, scene_at
from services.registration.core.nail.unknowns import Unknown, prior_mean
from services.registration.core.nail.window import Scale
from tests.unit.services.registration.rendered_case import (
    CAMERA_FROM_GUIDE,
    CAMERA_FROM_NAIL,
    Shown,
    rendered,
    rendered_parts,
)

_STEPS, _TOLERANCE, _A_LITTLE = 20, 0.5, 10.0
_TILTED_RAD = np.radians([(6.0, 0.0), (-6.0, 0.0), (0.0, 8.0), (5.0, -9.0)])


@cache
def problem() -> Problem:
    parts, (pixels, view) = rendered_parts(), rendered(Shown(), seed=3)
    given = Given(pixels, view, parts.nail, Occluders(PlacedGuide(parts.guide, CAMERA_FROM_GUIDE), parts.ring))
    detail = Detail(Scale(3, 0.8), 3.5, 4.0, 0.02)
    scene = scene_at(given, CAMERA_FROM_NAIL, detail)
    assert scene is not None
    return problem_for(scene, detail, POSE_ONLY)


def start(tilt_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    parameters = prior_mean()
    scene = problem().scene
    parameters[:POSE_SIZE] = parameters_from_pose(CAMERA_FROM_NAIL, scene.camera, scene.anchors)
    parameters[[Unknown.PITCH_RAD, Unknown.ROLL_RAD]] += tilt_rad
    return parameters


@cache
def ended(tilt: int) -> Solution:
    return minimise(problem(), start(_TILTED_RAD[tilt]), _STEPS, _TOLERANCE)


@pytest.mark.parametrize("tilt", range(len(_TILTED_RAD)))
def test_a_fit_is_given_up_only_when_it_ends_above_what_it_may_cost(tilt: int) -> None:
    allowed = 0.5 * ended(tilt).cost
    given_up = minimise(problem(), start(_TILTED_RAD[tilt]), _STEPS, _TOLERANCE, allowed)
    assert allowed < given_up.least_cost <= ended(tilt).cost
    assert given_up.steps < ended(tilt).steps
    assert not given_up.converged


@pytest.mark.parametrize("tilt", range(len(_TILTED_RAD)))
def test_a_fit_that_ends_a_little_below_what_it_may_cost_is_followed(tilt: int) -> None:
    followed = minimise(problem(), start(_TILTED_RAD[tilt]), _STEPS, _TOLERANCE, ended(tilt).cost + _A_LITTLE)
    assert followed.cost == followed.least_cost == ended(tilt).cost
    assert followed.converged
