"""How well a hole was seen does not depend on how much of its darkness the fit lays to the guide's body."""

from dataclasses import replace

import pytest

from services.registration.core.nail.judgement import hole_views
from services.registration.core.nail.solver import minimise
from services.registration.core.nail.stages import Detail
from services.registration.core.nail.window import Scale
from tests.unit.services.registration.rendered_case import pose_problem


def test_the_guides_body_and_the_background_behind_it_count_together() -> None:
    """Where the body covers the whole window, only the product of what it lets through and the background is known."""
    problem, start = pose_problem(Detail(Scale(2, 0.8), 3.5, 2.0, 0.01))
    solution = minimise(problem, start, 1, 2.0)
    linear = solution.linear
    brighter_body = replace(linear.appearance, delrin=15.0 * linear.appearance.delrin)
    traded = replace(linear, appearance=brighter_body, background=linear.background / 15.0)
    seen, same = (hole_views(problem, s) for s in (solution, replace(solution, linear=traded)))
    assert min(view.contrast_to_noise for view in seen) > 3.0
    assert [v.contrast_to_noise for v in same] == pytest.approx([v.contrast_to_noise for v in seen])
