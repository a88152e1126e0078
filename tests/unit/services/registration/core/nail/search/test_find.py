"""The nail's coarse search on rendered images: found from any direction, refused when it is not there."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.nail.search.band import Band
from services.registration.core.nail.search.find import NailDetection, camera_from_nail_facing, find_nail
from services.registration.core.nail.search.holes import StraightenedBand, find_pattern, hole_midpoints_mm
from shared.errors import Accepted, ReasonCode, Rejected
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import Line, angle_between_rad, unit
from shared.geometry.parts import Hole, NailPart, hole_surface_points
from shared.geometry.transform import Transform
from tests.unit.services.registration.xray_scene import (
    Rod,
    Scene,
    calibration,
    nail_part,
    pincushion,
    posed_nail,
    render,
)

SIZE_PX = 560


def across_ray_mm(
    nail: NailPart, estimated: Transform[Camera, Nail], true: Transform[Camera, Nail]
) -> NDArray[np.float64]:
    """Distance of each hole's middle from the true one, across the ray through it."""
    distances = []
    for hole in nail.holes:
        middle = np.mean(hole_surface_points(nail, hole), axis=0)
        place, error = true @ middle, estimated @ middle - true @ middle
        ray = place / np.linalg.norm(place)
        distances.append(np.linalg.norm(error - ray * (error @ ray)))
    return np.array(distances)


def found(result: Accepted[NailDetection] | Rejected) -> NailDetection:
    assert isinstance(result, Accepted), result
    return result.value


def refused(result: Accepted[NailDetection] | Rejected) -> tuple[ReasonCode, str]:
    assert isinstance(result, Rejected), result
    return result.reasons[0].code, result.reasons[0].message


def assert_found(
    nail: NailPart, start: NailDetection, true: Transform[Camera, Nail], tilt_deg: float, depth_mm: float = 14.0
) -> None:
    estimated = start.camera_from_nail
    assert across_ray_mm(nail, estimated, true).max() < 0.5
    assert abs(estimated.translation_mm[2] - true.translation_mm[2]) < depth_mm
    axis_deg = np.degrees(angle_between_rad(estimated.rotation[:, 2], true.rotation[:, 2]))
    assert axis_deg < tilt_deg + 1.0
    distal_deg = np.degrees(angle_between_rad(estimated.rotation[:, 0], true.rotation[:, 0]))
    assert distal_deg < tilt_deg + 2.0


@pytest.mark.parametrize("spin_deg", [0.0, 77.0, 135.0, 190.0, 301.0])
@pytest.mark.parametrize("material", ["steel", "Ti6Al4V"])
def test_the_nail_is_found_in_any_rotation(spin_deg: float, material: str) -> None:
    nail = nail_part(material="steel" if material == "steel" else "Ti6Al4V", diameter_mm=11.0, hole_diameter_mm=5.3)
    true = posed_nail(spin_deg, (2.0, -1.5), (4.0, -3.0, 730.0))
    view = calibration(SIZE_PX)
    pixels = render(Scene(SIZE_PX, nail, true), view, seed=int(spin_deg))
    assert_found(nail, found(find_nail(pixels, view, nail)), true, tilt_deg=2.5)


def test_it_is_found_where_something_dark_hides_more_than_half_of_the_band() -> None:
    nail, view, true = nail_part(), calibration(SIZE_PX), posed_nail(0.0, (2.0, -1.5), (4.0, -3.0, 730.0))
    pixels = render(Scene(SIZE_PX, nail, true), view, seed=2)
    covered = pixels.copy()
    holes_px = view.image_from_camera(true.points(hole_midpoints_mm(nail)))
    covered[:, : int(holes_px[:, 0].min()) - 40] = np.percentile(pixels, 5.0)
    assert_found(nail, found(find_nail(covered, view, nail)), true, tilt_deg=2.5)


def test_of_two_steep_edges_the_inner_one_is_the_nails() -> None:
    nail, view, true = nail_part(), calibration(SIZE_PX), posed_nail(0.0, (0.0, 0.0), (0.0, 0.0, 730.0))
    pixels = render(Scene(SIZE_PX, nail, true), view, seed=3)
    rows = np.arange(SIZE_PX)[:, None]
    edges_px = view.image_from_camera(true.points(np.array([[0.0, -nail.radius_mm, 0.0], [0.0, nail.radius_mm, 0.0]])))
    low, high = edges_px[:, 1].min(), edges_px[:, 1].max()
    beyond = 0.1 * (high - low)
    brighter = np.where((rows < low - beyond) | (rows > high + beyond), 1.8, 1.0)
    assert_found(nail, found(find_nail((pixels * brighter).astype(np.float32), view, nail)), true, tilt_deg=1.0)


@pytest.mark.parametrize("depth_mm", [660.0, 820.0])
def test_its_depth_may_be_anywhere(depth_mm: float) -> None:
    nail, view = nail_part(), calibration(SIZE_PX)
    true = posed_nail(40.0, (0.0, 0.0), (0.0, 0.0, depth_mm))
    pixels = render(Scene(SIZE_PX, nail, true), view, seed=1)
    assert_found(nail, found(find_nail(pixels, view, nail)), true, tilt_deg=0.0, depth_mm=8.0)


def test_tilted_holes_are_lenses_and_are_found() -> None:
    nail, view = nail_part(), calibration(SIZE_PX)
    true = posed_nail(20.0, (7.0, 7.0))
    start = found(find_nail(render(Scene(SIZE_PX, nail, true), view, seed=2), view, nail))
    assert_found(nail, start, true, tilt_deg=10.0)
    for major, minor in (opening.ellipse.semi_axes_px for opening in start.openings):
        assert minor < 0.9 * major


@pytest.mark.parametrize("hole_x_mm", [(0.0,), (10.0, -10.0), (15.0, -15.0, -35.0), (-35.0, 15.0, -5.0)])
def test_any_number_of_holes_at_any_spacing(hole_x_mm: tuple[float, ...]) -> None:
    nail, view = nail_part(hole_x_mm), calibration(SIZE_PX)
    true = posed_nail(-30.0, (1.0, 1.0), (3.0, 2.0, 740.0))
    start = found(find_nail(render(Scene(SIZE_PX, nail, true), view, seed=3), view, nail))
    assert [opening.hole_id for opening in start.openings] == [hole.id for hole in nail.holes]
    # With one hole the depth comes from the band's width, which is known to a few per cent only.
    assert_found(nail, start, true, tilt_deg=1.5, depth_mm=14.0 if len(hole_x_mm) > 1 else 40.0)


def test_a_slot_beside_a_bore_is_found_in_its_middle() -> None:
    parallel, view = nail_part(), calibration(SIZE_PX)
    distal, proximal = parallel.holes
    nail = replace(parallel, holes=(distal, replace(proximal, slot_length_mm=10.5)))
    true = posed_nail(25.0, (3.0, 1.0), (4.0, -3.0, 730.0))
    pixels = render(Scene(SIZE_PX, nail, true), view, seed=5)
    start = found(find_nail(pixels, view, nail))
    assert_found(nail, start, true, tilt_deg=3.5)
    slot = start.openings[1].ellipse
    px_per_mm = view.camera.focal_length_px / 730.0
    assert slot.reach_px == pytest.approx(5.25 * px_per_mm, rel=0.06)
    assert slot.semi_axes_px[0] == pytest.approx(3.0 * px_per_mm, rel=0.06)


def test_another_hole_is_not_taken_for_one_that_runs_across() -> None:
    parallel, view, true = nail_part((15.0,)), calibration(SIZE_PX), posed_nail(25.0, (3.0, 1.0), (4.0, -3.0, 730.0))
    shown = parallel.holes[0]
    across = Hole("across", Line(np.zeros(3), np.array([0.0, 1.0, 0.0])), shown.diameter_mm)
    nail = replace(parallel, other_holes=(across,))
    pixels = render(Scene(SIZE_PX, nail, true), view, seed=5)
    assert_found(nail, found(find_nail(pixels, view, nail)), true, tilt_deg=3.5, depth_mm=40.0)
    turned = replace(parallel, holes=(across,), other_holes=(shown,))
    code, message = refused(find_nail(pixels, view, turned))
    assert code is ReasonCode.NAIL_NOT_FOUND
    assert "could be hole 'across'" in message
    assert "other holes ('distal')" in message


def test_balls_on_the_holes_rims_are_left_out() -> None:
    nail, view = nail_part(), calibration(SIZE_PX)
    true = posed_nail(65.0)
    rims = np.array([[15.0, 3.0, -100.0], [-13.0, -2.5, -100.0], [-15.0, 3.5, 180.0]])
    balls = np.column_stack([true.points(rims), np.full(3, 2.0)])
    start = found(find_nail(render(Scene(SIZE_PX, nail, true, balls=balls), view, seed=4), view, nail))
    assert_found(nail, start, true, tilt_deg=0.0)
    assert min(opening.seen_fraction for opening in start.openings) < 0.95


def test_distortion_is_taken_out() -> None:
    nail, view = nail_part(), calibration(SIZE_PX, pincushion(SIZE_PX, 0.06))
    true = posed_nail(110.0, (1.0, 0.0), (8.0, 12.0, 740.0))
    start = found(find_nail(render(Scene(SIZE_PX, nail, true), view, seed=5), view, nail))
    # 1 degree against the camera's axis, 1.1 more against the ray: the nail is 14 mm off the axis.
    assert_found(nail, start, true, tilt_deg=2.1, depth_mm=8.0)


def test_an_image_without_a_nail_is_refused() -> None:
    view = calibration(SIZE_PX)
    screw = Rod(np.array([20.0, 20.0, 700.0]), np.array([35.0, 28.0, 700.0]), 5.0)
    code, message = refused(find_nail(render(Scene(SIZE_PX, rods=(screw,)), view, seed=6), view, nail_part()))
    assert code is ReasonCode.NAIL_NOT_FOUND
    assert "12 mm nail's width" in message


def test_a_nail_whose_holes_are_turned_away_is_refused() -> None:
    nail, view = nail_part(), calibration(SIZE_PX)
    turned = posed_nail(0.0).rotation @ np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    true: Transform[Camera, Nail] = Transform.from_rotation_translation(turned, np.array([0.0, 0.0, 740.0]))
    code, message = refused(find_nail(render(Scene(SIZE_PX, nail, true), view, seed=7), view, nail))
    assert code is ReasonCode.HOLE_NOT_VISIBLE
    assert "turn the C-arm" in message


@pytest.mark.requirement("REG-03")
def test_another_nails_file_is_refused() -> None:
    true, view = posed_nail(15.0), calibration(SIZE_PX)
    pixels = render(Scene(SIZE_PX, nail_part(), true), view, seed=8)
    code, message = refused(find_nail(pixels, view, nail_part(diameter_mm=13.5)))
    assert code is ReasonCode.NAIL_MODEL_MISMATCH
    assert "check the nail file" in message


def without_tip(seed: int) -> tuple[NailPart, Transform[Camera, Nail], CArmCalibration, NDArray[np.float32]]:
    """An image in which both ends of a symmetric nail run out of view."""
    nail, size_px = nail_part(), 380
    true, view = posed_nail(0.0), calibration(size_px)
    return nail, true, view, render(Scene(size_px, nail, true), view, seed)


def test_without_the_tip_the_direction_is_not_guessed() -> None:
    nail, _, view, pixels = without_tip(seed=9)
    code, message = refused(find_nail(pixels, view, nail))
    assert code is ReasonCode.NAIL_NOT_FOUND
    assert "not its distal end" in message


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_without_the_tip_the_hint_decides(sign: float) -> None:
    nail, true, view, pixels = without_tip(seed=10)
    start = found(find_nail(pixels, view, nail, distal_hint_camera=sign * np.array([0.9, 0.3, 0.1])))
    assert sign * float(start.camera_from_nail.rotation[:, 0] @ true.rotation[:, 0]) > 0.99


def test_a_hint_against_a_visible_tip_is_refused() -> None:
    nail, view = nail_part(), calibration(SIZE_PX)
    true = posed_nail(30.0)
    pixels = render(Scene(SIZE_PX, nail, true), view, seed=11)
    code, message = refused(find_nail(pixels, view, nail, distal_hint_camera=-true.rotation[:, 0]))
    assert code is ReasonCode.NAIL_MODEL_MISMATCH
    assert "tip_x_mm" in message


def test_grey_values_may_have_any_scale_and_type() -> None:
    nail, view = nail_part(), calibration(SIZE_PX)
    true = posed_nail(250.0)
    pixels = render(Scene(SIZE_PX, nail, true), view, seed=12)
    eight_bits = np.clip(pixels * 180.0 + 20.0, 0, 255).astype(np.uint8)
    assert_found(nail, found(find_nail(eight_bits, view, nail)), true, tilt_deg=0.0)


def test_openings_brighter_than_what_lies_beside_the_nail_leave_no_tie_among_places() -> None:
    """Openings as bright as that satisfy every scale; the pattern must still lie in their middle."""
    nail, px_per_mm = nail_part(hole_x_mm=(10.5, -10.5), diameter_mm=12.5), 3.0
    rows, columns = np.mgrid[-41:42, 0:300]
    grey = np.where(np.abs(rows) < 0.5 * 12.5 * px_per_mm, 0.3, 0.5)
    for hole in nail.holes:
        along = columns - 150.0 - px_per_mm * hole.axis.point_mm[0]
        grey = np.where(np.hypot(along, rows) < 3.0 * px_per_mm, 0.9, grey)
    band = Band(np.array([150.0, 0.0]), np.array([1.0, 0.0]), 12.5 * px_per_mm, 250.0)
    level = np.ones(300)
    strip = StraightenedBand(band, grey.astype(np.float32), np.ones(300, dtype=bool), -150.0, 0.2 * level)
    forwards, backwards = find_pattern(strip, nail)
    for pattern in (forwards, backwards):
        middles = np.sort(pattern.centre_search_px[:, 0])
        assert middles == pytest.approx([150.0 - 31.5, 150.0 + 31.5], abs=2.5)
        assert pattern.centre_search_px[:, 1] == pytest.approx(0.0, abs=2.0)


def rays_of(nail: NailPart, pose: Transform[Camera, Nail]) -> NDArray[np.float64]:
    return unit(pose.points(hole_midpoints_mm(nail)))


@pytest.mark.parametrize("rough_deg", [0.0, 25.0, -60.0])
@pytest.mark.parametrize("hole_x_mm", [(15.0, -15.0), (20.0, -10.0, -35.0)])
def test_an_untilted_nail_is_recovered_from_a_rough_direction(hole_x_mm: tuple[float, ...], rough_deg: float) -> None:
    nail, true = nail_part(hole_x_mm), posed_nail(130.0, at_mm=(0.0, 0.0, 712.0))
    rough = posed_nail(130.0 + rough_deg).rotation[:, 0]
    found = camera_from_nail_facing(nail, rays_of(nail, true), np.array([0.0, 0.0, 1.0]), rough, 0.0)
    assert found.matrix == pytest.approx(true.matrix, abs=1e-9)


def test_one_hole_takes_depth_and_direction_from_the_band() -> None:
    nail, true = nail_part((4.0,)), posed_nail(-70.0, at_mm=(0.0, 0.0, 712.0))
    found = camera_from_nail_facing(nail, rays_of(nail, true), np.array([0.0, 0.0, 1.0]), true.rotation[:, 0], 712.0)
    assert found.matrix == pytest.approx(true.matrix, abs=1e-9)


def test_the_holes_axis_is_the_one_asked_for() -> None:
    nail, axis = nail_part(), unit(np.array([0.05, -0.03, 1.0]))
    found = camera_from_nail_facing(nail, rays_of(nail, posed_nail(10.0)), axis, np.array([1.0, 0.2, 0.0]), 0.0)
    assert found.rotation[:, 2] == pytest.approx(axis, abs=1e-12)
