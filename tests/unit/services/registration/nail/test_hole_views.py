"""How well a hole was seen does not depend on how much of its darkness the fit lays to the guide's body."""

from dataclasses import replace

import pytest

from services.registration.core.nail.capture import POSE_ONLY
from services.registration.core.nail.judgement import hole_views
from services.registration.core.nail.occluders import Occluders, PlacedGuide
from services.registration.core.nail.pose import POSE_SIZE, parameters_from_pose
from services.registration.core.nail.solver import minimise
from services.registration.core.nail.stages import Detail, Given, problem_for, scene_at
from services.registration.core.nail.unknowns import prior_mean
from services.registration.core.nail.window import Scale
from tests.unit.services.registration.rendered_case import (
    CAMERA_FROM_GUIDE,
    CAMERA_FROM_NAIL,
    Shown,
    rendered,
    rendered_parts,
)


def test_the_guides_body_and_the_background_behind_it_count_together() -> None:
    """Where the body covers the whole window, only the product of what it lets through and the background is known."""
    parts, (pixels, view) = rendered_parts(), rendered(Shown(), seed=3)
    given = Given(pixels, view, parts.nail, Occluders(PlacedGuide(parts.guide, CAMERA_FROM_GUIDE), parts.ring))
    detail = Detail(Scale(2, 0.8), 3.5, 2.0, 0.01)
    scene = scene_at(given, CAMERA_FROM_NAIL, detail)
    assert scene is not None
    problem = problem_for(scene, detail, POSE_ONLY)
    start = prior_mean()
    start[:POSE_SIZE] = parameters_from_pose(CAMERA_FROM_NAIL, scene.camera, scene.anchors)
    solution = minimise(problem, start, 1, 2.0)
    linear = solution.linear
    brighter_body = replace(linear.appearance, delrin=15.0 * linear.appearance.delrin)
    traded = replace(linear, appearance=brighter_body, background=linear.background / 15.0)
    seen, same = (hole_views(problem, s) for s in (solution, replace(solution, linear=traded)))
    assert min(view.contrast_to_noise for view in seen) > 3.0
    assert [v.contrast_to_noise for v in same] == pytest.approx([v.contrast_to_noise for v in seen])
