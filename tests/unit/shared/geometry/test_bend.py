"""Cross-sections of a bent nail: on a circle, by length, and as they move with the curvature."""

import numpy as np
import pytest

from shared.geometry.bend import motion_by_curvature, places_along, section_frame
from shared.geometry.lines import Line
from shared.geometry.parts import Hole, NailPart, hole_axis, hole_surface_points

CURVATURE = (1.2, -1.6)  # radius 500 mm
HOLES = (
    Hole("distal", Line(np.array([15.0, 0.5, 0.0]), np.array([0.0, 0.0, 1.0])), 5.0),
    Hole("proximal", Line(np.array([-15.0, 0.0, 0.0]), np.array([0.0, 0.3, 1.0])), 5.0),
)
STRAIGHT = NailPart("steel", 12.0, 0.0, 38.0, HOLES, "0" * 64)
BENT = STRAIGHT.bent(CURVATURE)


@pytest.mark.parametrize("x_mm", [-40.0, 0.0, 25.0])
def test_sections_lie_on_a_circle_by_their_length(x_mm: float) -> None:
    centre = np.array([0.0, 300.0, -400.0])
    frame = section_frame(CURVATURE, x_mm)
    assert np.linalg.norm(frame.translation_mm - centre) == pytest.approx(500.0, abs=1e-9)
    assert frame.rotation[:, 0] @ (frame.translation_mm - centre) == pytest.approx(0.0, abs=1e-9)
    assert np.linalg.norm(frame.rotation_vector_rad) == pytest.approx(abs(x_mm) / 500.0)


def test_the_curvature_turns_the_centre_line_towards_y_and_z() -> None:
    ahead = section_frame(CURVATURE, 50.0).translation_mm
    assert ahead == pytest.approx([49.9, 1.5, -2.0], abs=0.03)


@pytest.mark.parametrize("curvature", [(0.0, 0.0), CURVATURE, (-3.0, 0.5)])
@pytest.mark.parametrize("x_mm", [-30.0, 17.0])
def test_motions_by_the_curvature_are_differences_of_sections(curvature: tuple[float, float], x_mm: float) -> None:
    found, step = motion_by_curvature(curvature, x_mm), 1e-3
    for k, (y, z) in enumerate(((step, 0.0), (0.0, step))):
        after = section_frame((curvature[0] + y, curvature[1] + z), x_mm)
        before = section_frame((curvature[0] - y, curvature[1] - z), x_mm)
        assert found[:, k] == pytest.approx((after @ before.inverse()).log() / (2.0 * step), abs=1e-7)


@pytest.mark.parametrize("curvature", [(0.0, 0.0), CURVATURE])
def test_rays_pass_nearest_to_the_centre_line_where_nothing_else_is_nearer(curvature: tuple[float, float]) -> None:
    spot, rng = np.array([20.0, -30.0, -700.0]), np.random.default_rng(3)
    directions = np.column_stack([rng.uniform(-25.0, 25.0, 20), rng.uniform(-6.0, 6.0, 20), np.zeros(20)]) - spot
    x_mm = np.arange(-45.0, 45.0, 0.01)
    line = np.stack([section_frame(curvature, float(x)).translation_mm for x in x_mm])
    for direction, place in zip(directions, places_along(spot, directions, curvature), strict=True):
        away = np.linalg.norm(np.cross(line - spot, direction), axis=1)
        assert place == pytest.approx(x_mm[np.argmin(away)], abs=0.02)


def test_a_bent_nails_holes_have_axes_of_their_own() -> None:
    first, second = (hole_axis(BENT, hole) for hole in HOLES)
    assert first.direction == pytest.approx(section_frame(CURVATURE, 15.0).rotation[:, 2])
    straight = HOLES[0].axis.direction @ HOLES[1].axis.direction
    assert abs(first.direction @ second.direction - straight) > 1e-4
    assert hole_axis(STRAIGHT, HOLES[0]) is HOLES[0].axis


@pytest.mark.parametrize("hole", HOLES)
def test_entry_and_exit_stay_on_the_surface_and_on_the_axis(hole: Hole) -> None:
    axis, back = hole_axis(BENT, hole), section_frame(CURVATURE, float(hole.axis.point_mm[0])).inverse()
    for end in hole_surface_points(BENT, hole):
        assert axis.distance_mm(end) == pytest.approx(0.0, abs=1e-9)
        assert np.hypot(*(back @ end)[1:]) == pytest.approx(BENT.radius_mm)
