"""The move that lays the guide's axes on the nail's: exact, within reach, least travel, or a refusal with figures."""

from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from services.registration.core import plan
from services.registration.core.acceptance.criteria import PlanRefusal
from services.registration.core.drill_clearance import AxisOffset
from services.registration.core.hole_axes import HoleEstimate
from services.registration.core.hole_axes import holes_at as nail_holes_at
from services.registration.core.plan import (
    PlannedMove,
    RobotNow,
    plan_move,
)
from services.registration.core.tuning import PLAN_SEARCH
from shared.acceptance import Refusal
from shared.errors import Accepted
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.hexapod import PlatformPose, base_from_top
from shared.geometry.hexapod_limits import HexapodLimit, LimitViolation, path_violations
from shared.geometry.lines import Line
from shared.geometry.parts import GuidePart
from shared.geometry.transform import Transform
from shared.parts.hexapod_file import default_hexapod
from tests.unit.services.registration.xray_scene import guide_part, nail_part

HEXAPOD = default_hexapod()
DIAMETER_MM = 5.3
NAIL_MM = 11.0
SURE = 1e-4 * np.eye(4)
BOTH = ("distal", "proximal")


def robot_at(pose: PlatformPose | None = None) -> RobotNow:
    return RobotNow(HEXAPOD, pose or HEXAPOD.home_pose, np.array(HEXAPOD.pivot_mm), 60.0)


def holes_at(
    guide_from_nail: Transform[Guide, Nail], x_mm: tuple[float, float] = (15.0, -15.0)
) -> tuple[HoleEstimate, ...]:
    holes = []
    for name, x in zip(BOTH, x_mm, strict=True):
        entry, leaving = (guide_from_nail @ np.array([x, 0.0, z]) for z in (-NAIL_MM / 2, NAIL_MM / 2))
        axis = Line(entry, guide_from_nail.directions(np.array([0.0, 0.0, 1.0])))
        holes.append(
            HoleEstimate(name, axis, entry, leaving, DIAMETER_MM, 4.0, 2.0, AxisOffset(np.zeros(4), SURE, NAIL_MM))
        )
    return tuple(holes)


def nail_at(tilt_xyz_deg: tuple[float, float, float], across_mm: tuple[float, float]) -> Transform[Guide, Nail]:
    """A nail 107 mm along the drill; the guide's middle is off its axis by so much."""
    rotation = Rotation.from_euler("xyz", tilt_xyz_deg, degrees=True).as_matrix()
    return Transform.from_rotation_translation(rotation, rotation @ np.array([*across_mm, 107.0]))


def planned(holes: tuple[HoleEstimate, ...], hole_ids: tuple[str, ...], robot: RobotNow | None = None) -> PlannedMove:
    outcome = plan_move(holes, guide_part(), hole_ids, robot or robot_at())
    assert isinstance(outcome, Accepted), outcome
    return outcome.value


def refused(
    holes: tuple[HoleEstimate, ...], hole_ids: tuple[str, ...], robot: RobotNow | None = None
) -> Refusal[PlanRefusal]:
    outcome = plan_move(holes, guide_part(), hole_ids, robot or robot_at())
    assert isinstance(outcome, Refusal), outcome
    return outcome


def guide_hole_after(move: PlannedMove, robot: RobotNow, part: GuidePart, hole_id: str) -> Line:
    """The guide hole's axis in the guide's old frame, by way of the hexapod's poses alone."""
    top_from_guide = HEXAPOD.top_from_guide(robot.head_extension_mm)
    before = base_from_top(HEXAPOD, robot.pose, robot.pivot_mm) @ top_from_guide
    after = base_from_top(HEXAPOD, move.target_pose, robot.pivot_mm) @ top_from_guide
    old_from_new = before.inverse() @ after
    axis = next(h.axis for h in part.holes if h.id == hole_id)
    return Line(old_from_new @ axis.point_mm, old_from_new.directions(axis.direction))


tilts = st.floats(-4.0, 4.0)
offsets = st.floats(-4.0, 4.0)


@pytest.mark.requirement("REG-14")
@settings(max_examples=25, deadline=None)
@given(u=tilts, v=tilts, w=tilts, x=offsets, y=offsets)
def test_both_axes_coincide_after_the_move(u: float, v: float, w: float, x: float, y: float) -> None:
    holes, robot = holes_at(nail_at((u, v, w), (x, y))), robot_at()
    move = planned(holes, BOTH, robot)
    for hole in holes:
        after = guide_hole_after(move, robot, guide_part(), hole.id)
        assert after.distance_mm(hole.entry_guide_mm) < 1e-5
        assert after.distance_mm(hole.exit_guide_mm) < 1e-5
        assert after.direction @ hole.axis_guide.direction > 0.999
    assert path_violations(HEXAPOD, robot.pose, move.target_pose, robot.pivot_mm) == ()


def test_one_hole_leaves_rotation_and_travel_free_and_uses_neither() -> None:
    holes = holes_at(nail_at((3.0, -2.0, 15.0), (2.0, -3.0)), (12.0, -12.0))
    robot = robot_at()
    move = planned(holes, ("distal",), robot)
    after = guide_hole_after(move, robot, guide_part(), "distal")
    assert after.distance_mm(holes[0].entry_guide_mm) < 1e-5
    assert after.distance_mm(holes[0].exit_guide_mm) < 1e-5
    assert move.axial_shift_mm == 0.0
    # the smallest rotation tilts by 3.6 degrees; turning with the nail as well would be 15 degrees more
    assert move.travel_deg < 4.0


def test_a_guide_that_is_right_already_stays() -> None:
    move = planned(holes_at(nail_at((0.0, 0.0, 0.0), (0.0, 0.0))), BOTH)
    assert move.travel_mm < 1e-9
    assert move.travel_deg < 1e-9
    assert np.allclose(move.target_pose.as_array(), HEXAPOD.home_pose.as_array(), atol=1e-9)


@pytest.mark.requirement("REG-14")
def test_unequal_spacings_are_planned_one_by_one() -> None:
    holes = holes_at(nail_at((1.0, 1.0, 0.0), (1.0, 1.0)), (12.5, -12.5))
    refusal = refused(holes, BOTH)
    assert refusal.code is PlanRefusal.UNEQUAL_SPACING
    assert "2.50 mm (limit 0.25 mm) would remain" in refusal.message
    assert "one hole per move" in refusal.message
    for hole in holes:
        assert planned(holes, (hole.id,)).predicted[0].offset.entry_mm < 1e-5


def test_holes_of_a_bent_nail_are_planned_one_by_one() -> None:
    guide_from_nail, nail = nail_at((1.0, 1.0, 0.0), (1.0, 1.0)), nail_part().bent((0.0, 3.2))
    view: Transform[Camera, Nail] = Transform.from_rotation_translation(np.eye(3), np.array([0.0, 0.0, 740.0]))
    holes = nail_holes_at(nail, 4.0, guide_from_nail, 1e-10 * np.eye(8), view)
    refusal = refused(holes, BOTH)
    assert refusal.code is PlanRefusal.UNEQUAL_SPACING
    assert "its axes are 5.5° apart and the guide's 0.0°" in refusal.message
    assert "hole_ids ['distal']; hole_ids ['proximal']" in refusal.message
    for hole in holes:
        assert planned(holes, (hole.id,)).predicted[0].angle_deg < 1e-5


def test_slightly_unequal_spacings_share_the_error_and_say_so() -> None:
    move = planned(holes_at(nail_at((0.0, 0.0, 0.0), (0.0, 0.0)), (15.1, -15.1)), BOTH)
    assert [round(p.offset.entry_mm, 3) for p in move.predicted] == [0.1, 0.1]


def test_free_travel_brings_a_far_target_into_reach() -> None:
    """Near the top of its travel a tilt is out of reach; shifted along the axis it is not."""
    high = replace(HEXAPOD.home_pose, z_mm=6.0)
    holes, robot = holes_at(nail_at((5.0, -4.0, 3.0), (2.0, 4.0))), robot_at(high)
    move = planned(holes, BOTH, robot)
    assert move.axial_shift_mm != 0.0
    assert abs(move.axial_shift_mm) <= PLAN_SEARCH.longest_shift_mm
    for hole in holes:
        assert guide_hole_after(move, robot, guide_part(), hole.id).distance_mm(hole.entry_guide_mm) < 1e-5
    assert path_violations(HEXAPOD, robot.pose, move.target_pose, robot.pivot_mm) == ()


@pytest.mark.requirement("REG-14")
def test_out_of_reach_says_which_leg_and_how_far() -> None:
    refusal = refused(holes_at(nail_at((0.0, 0.0, 0.0), (60.0, 0.0))), BOTH)
    assert refusal.code is PlanRefusal.OUT_OF_REACH
    assert "mm long, it can be" in refusal.message
    assert "remount" in refusal.message


def test_a_way_that_alone_leaves_the_workspace_is_refused_with_what_it_breaks(monkeypatch: pytest.MonkeyPatch) -> None:
    broken = LimitViolation(HexapodLimit.LEG_LENGTH, "after 40 % of the way, leg 2 would be 130.00 mm long; remount")
    monkeypatch.setattr(plan, "path_violations", Mock(return_value=(broken,)))
    refusal = refused(holes_at(nail_at((1.0, 0.0, 0.0), (1.0, 0.0))), BOTH)
    assert refusal.code is PlanRefusal.OUT_OF_REACH
    assert f"onto the axes: {broken.message}. With up to" in refusal.message
    assert refusal.message.endswith(f"where still {broken.message}")


@pytest.mark.parametrize("hole_ids", [("middle",), (), ("distal", "distal")])
def test_unknown_holes_are_refused(hole_ids: tuple[str, ...]) -> None:
    refusal = refused(holes_at(nail_at((0.0, 0.0, 0.0), (0.0, 0.0))), hole_ids)
    assert refusal.code is PlanRefusal.UNKNOWN_HOLE
    assert "distal, proximal" in refusal.message


def test_a_localisation_without_uncertainty_moves_nothing() -> None:
    holes = tuple(replace(h, offset=None) for h in holes_at(nail_at((0.0, 0.0, 0.0), (0.0, 0.0))))
    assert refused(holes, BOTH).code is PlanRefusal.UNKNOWN_UNCERTAINTY


def test_predicted_error_adds_the_robot_to_the_localisation() -> None:
    def entry_sd_mm(covariance: NDArray[np.float64]) -> float:
        holes = tuple(
            replace(h, offset=AxisOffset(np.zeros(4), covariance, NAIL_MM))
            for h in holes_at(nail_at((1.0, 0.0, 0.0), (1.0, 0.0)))
        )
        return planned(holes, BOTH).predicted[0].offset.entry_sd_mm

    robot_only = entry_sd_mm(np.zeros((4, 4)))
    assert 0.05 < robot_only < 0.15
    assert entry_sd_mm(0.04 * np.eye(4)) == pytest.approx(np.hypot(robot_only, 0.2 * np.sqrt(2.0)))
