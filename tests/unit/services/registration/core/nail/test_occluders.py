"""Balls and the guide's body are looked at at places spread as their penumbra at their own depth."""

from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.nail.occluders import (
    Balls,
    Occluders,
    Penumbra,
    PlacedGuide,
    SteelRod,
    add_ball_paths,
    add_rod_path,
    guide_body_path,
    guide_body_path_mm,
    steel_path_mm,
)
from services.registration.core.nail.rays import SAMPLES_PX, PixelRays
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Guide
from shared.geometry.lines import Line
from shared.geometry.parts import BallPattern, Box, GuidePart, Hole
from shared.geometry.transform import Transform
from tests.unit.services.registration.rendered_case import CAMERA_FROM_GUIDE, CAMERA_FROM_NAIL, rendered_parts
from tests.unit.services.registration.xray_scene import FOCAL_PX, RING_DEPTH_MM, calibration

PARTS, VIEW = rendered_parts(), calibration(512)
PENUMBRA = Penumbra.beside(VIEW, float(CAMERA_FROM_NAIL.translation_mm[2]), 1.0)

NAIL_MM, SPOT_MM = 720.0, 0.5
PX_PER_MM = FOCAL_PX / RING_DEPTH_MM

ACROSS = SteelRod(np.array([-20.0, 0.0, 700.0]), np.array([30.0, 0.0, 700.0]), 2.0)
ALONG = SteelRod(np.array([0.0, 0.0, 600.0]), np.array([0.0, 0.0, 640.0]), 2.0)


def rays_about(slope: NDArray[np.float64], columns: int) -> PixelRays:
    """A row of pixels about a direction (x, y) at z = 1."""
    step = 1.0 / FOCAL_PX
    slopes = slope + np.column_stack([step * (np.arange(columns) - columns // 2), np.zeros(columns)])
    of_all = np.ones((columns, 1))
    return PixelRays(slopes, of_all * [step, 0.0], of_all * [0.0, step])


def chords_mm(slopes: NDArray[np.float64], centre_mm: NDArray[np.float64], radius_mm: float) -> NDArray[np.float64]:
    """Lengths in a ball by its distance from each ray, slopes of shape (..., 2)."""
    directions = np.concatenate([slopes, np.ones((*slopes.shape[:-1], 1))], axis=-1)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    apart_mm = np.linalg.norm(np.cross(directions, centre_mm), axis=-1)
    return np.asarray(2.0 * np.sqrt(np.maximum(radius_mm**2 - apart_mm**2, 0.0)))


def expected_spread(depth_mm: float) -> float:
    """A square spot's penumbra is as wide as the spot, by the depths behind and before the edge."""
    at, at_nail = (0.5 * FOCAL_PX / RING_DEPTH_MM * (RING_DEPTH_MM / z - 1.0) for z in (depth_mm, PENUMBRA.nail_mm))
    return float(np.sqrt(1.0 + at**2 - at_nail**2))


def lone_ball(*, of_ring: bool) -> tuple[Occluders, NDArray[np.float64], float]:
    """Something with balls, and the place and radius of one that no other hides."""
    balls = PARTS.ring.balls if of_ring else PARTS.guide.balls
    pose = VIEW.camera_from_ring if of_ring else CAMERA_FROM_GUIDE
    centres_mm = pose.points(balls.position_mm)
    shadows = centres_mm[:, :2] / centres_mm[:, 2:]
    nearest = np.sort(np.linalg.norm(shadows[:, None] - shadows, axis=-1), axis=1)[:, 1]
    lone = int(nearest.argmax())
    guide = None if of_ring else PlacedGuide(PARTS.guide, CAMERA_FROM_GUIDE)
    return Occluders(guide, PARTS.ring if of_ring else None), centres_mm[lone], 0.5 * float(balls.diameter_mm[lone])


@pytest.mark.parametrize("of_ring", [False, True])
def test_a_ball_is_as_soft_as_its_depth_makes_it(*, of_ring: bool) -> None:
    occluders, centre_mm, radius_mm = lone_ball(of_ring=of_ring)
    rays = rays_about(centre_mm[:2] / centre_mm[2], 41)
    spread = expected_spread(float(centre_mm[2]))
    assert spread < 0.9 if of_ring else spread > 1.1
    places = rays.slopes[:, None] + spread * SAMPLES_PX / FOCAL_PX
    found = steel_path_mm(rays, occluders, VIEW, PENUMBRA)
    assert found == pytest.approx(chords_mm(places, centre_mm, radius_mm), abs=1e-6)
    assert np.count_nonzero(found.any(axis=1)) >= 2.0 * radius_mm * FOCAL_PX / centre_mm[2]


def test_the_guides_body_has_edges_as_soft_as_its_depth_makes_them() -> None:
    """Rays that cross a thin plate's side: where they leave it is spread as the places are."""
    depth_mm, side_mm = 600.0, 20.0
    plate = GuidePart(BallPattern((), np.zeros((0, 3)), np.zeros(0)), (), (Box((0, 0, 0), (40.0, 40.0, 1e-3)),), "")
    pose: Transform[Camera, Guide] = Transform.from_rotvec(np.zeros(3), [0.0, 0.0, depth_mm])
    off_px = np.arange(-2.0, 2.0, 0.01)
    slopes = np.column_stack([side_mm / depth_mm + off_px / FOCAL_PX, np.zeros_like(off_px)])
    of_all = np.ones((len(off_px), 1)) / FOCAL_PX
    rays = PixelRays(slopes, of_all * [1.0, 0.0], of_all * [0.0, 1.0])
    path_mm = guide_body_path_mm(rays, Occluders(PlacedGuide(plate, pose), None), PENUMBRA)
    leaves = -np.diff(path_mm) / (path_mm[0] - path_mm[-1])
    middle = 0.5 * (off_px[1:] + off_px[:-1])
    variance = leaves @ middle**2 - (leaves @ middle) ** 2
    assert variance == pytest.approx(expected_spread(depth_mm) ** 2 / 12.0, rel=0.02)


def view() -> CArmCalibration:
    return calibration(512)


def places_of_an_edge_px(depth_mm: float) -> NDArray[np.float64]:
    """Where rays that pass one point of a depth meet the detector, from all over the spot and to all of a pixel."""
    evenly = (np.arange(40) + 0.5) / 40 - 0.5
    places = []
    for in_pixel, on_spot in product(evenly, evenly):
        slope = (0.0 - on_spot * SPOT_MM) / depth_mm
        places.append(in_pixel + PX_PER_MM * (on_spot * SPOT_MM + slope * RING_DEPTH_MM))
    return np.array(places)


@pytest.mark.parametrize("depth_mm", [600.0, 660.0, NAIL_MM, 780.0])
def test_places_and_the_nails_blur_spread_an_edge_as_the_focal_spot_does(depth_mm: float) -> None:
    spread = float(Penumbra.beside(view(), NAIL_MM, 1.0).spread(np.array(depth_mm)))
    by_places = spread**2 / 12.0
    by_nails_blur = float(np.var(places_of_an_edge_px(NAIL_MM))) - 1.0 / 12.0
    assert by_places + by_nails_blur == pytest.approx(float(np.var(places_of_an_edge_px(depth_mm))), rel=0.01)


def test_what_lies_at_the_nails_depth_is_as_soft_as_the_nail() -> None:
    assert Penumbra.beside(view(), NAIL_MM, 1.0).spread(np.array([NAIL_MM])) == pytest.approx([1.0])


def test_the_rings_balls_are_sharper_but_never_sharper_than_a_point() -> None:
    at_detector = np.array([RING_DEPTH_MM, RING_DEPTH_MM + 10.0])
    taken_away = float(np.var(places_of_an_edge_px(NAIL_MM))) - 1.0 / 12.0
    spread = Penumbra.beside(view(), NAIL_MM, 1.0).spread(at_detector)
    assert spread == pytest.approx(np.sqrt(1.0 - 12.0 * taken_away), rel=0.01)
    assert (spread < 0.75).all()
    assert (Penumbra.beside(view(), 300.0, 1.0).spread(at_detector) > 0.0).all()


def test_large_pixels_hide_penumbras() -> None:
    depth = np.array([600.0])
    assert (
        1.0 < Penumbra.beside(view(), NAIL_MM, 3.0).spread(depth) < Penumbra.beside(view(), NAIL_MM, 1.0).spread(depth)
    )


def test_a_ball_on_the_ray_is_as_thick_as_its_diameter() -> None:
    centres = np.array([[5.0, -3.0, 600.0], [80.0, 0.0, 600.0]])
    slopes = np.array([[5.0 / 600.0, -3.0 / 600.0], [0.02, 0.0]])
    nothing = np.zeros_like(slopes)
    out = np.array([[0.5], [0.0]])
    balls = Balls(centres, np.array([1.0, 1.0]), np.ones(2))
    add_ball_paths(PixelRays(slopes, nothing, nothing), np.zeros((1, 2)), balls, out)
    assert out[:, 0] == pytest.approx([2.5, 0.0])


@pytest.mark.parametrize(("spread", "path_mm"), [(0.5, 2.0 * np.sqrt(1.0 - 0.25**2)), (2.2, 0.0)])
def test_a_ball_is_looked_at_as_far_from_the_middle_of_a_pixel_as_its_spread_says(
    spread: float, path_mm: float
) -> None:
    far, slopes = 1e6, np.zeros((1, 2))
    rays = PixelRays(slopes, np.array([[1.0 / far, 0.0]]), np.array([[0.0, 1.0 / far]]))
    out = np.zeros((1, 1))
    balls = Balls(np.array([[0.0, 0.0, far]]), np.ones(1), np.array([spread]))
    add_ball_paths(rays, np.array([[0.3, -0.4]]), balls, out)
    assert out[0, 0] == pytest.approx(path_mm, abs=1e-3)


def test_the_guides_body_is_as_thick_as_its_box_and_empty_in_its_bore() -> None:
    no_balls = BallPattern((), np.zeros((0, 3)), np.zeros(0))
    bore = Hole("distal", Line(np.array([10.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])), 8.0)
    guide = GuidePart(no_balls, (bore,), (Box((0.0, 0.0, 0.0), (55.0, 40.0, 15.0)),), "")
    pose = Transform[Camera, Guide].from_rotation_translation(np.eye(3), [0.0, 0.0, 630.0])
    slopes = np.array([[0.0, 0.0], [10.0 / 630.0, 0.0], [40.0 / 630.0, 0.0]])
    nothing = np.zeros_like(slopes)
    middle = np.zeros((1, 2))
    assert guide_body_path(PixelRays(slopes, nothing, nothing), middle, pose, guide) == pytest.approx([15.0, 0.0, 0.0])


def test_a_pixel_across_the_bodys_side_sees_the_mean_of_its_places() -> None:
    no_balls = BallPattern((), np.zeros((0, 3)), np.zeros(0))
    guide = GuidePart(no_balls, (), (Box((0.0, 0.0, 0.0), (40.0, 40.0, 1e-3)),), "")
    pose = Transform[Camera, Guide].from_rotation_translation(np.eye(3), [0.0, 0.0, 600.0])
    slopes, step = np.array([[0.0, 20.0 / 600.0]]), np.array([[1.0 / 600.0, 0.0]])
    places = np.array([[0.0, -0.4], [0.0, -0.1], [0.0, 0.1], [0.4, -0.2]])
    found = guide_body_path(PixelRays(slopes, step, step[:, ::-1].copy()), places, pose, guide)
    assert found == pytest.approx([0.75e-3], rel=2e-3)


def path_mm(rod: SteelRod, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Through points of the camera's frame, shape (N, 3)."""
    out = np.zeros(len(points))
    add_rod_path(np.ascontiguousarray(points[:, :2] / points[:, 2:]), rod, out)
    return out


def test_a_rod_across_the_beam_is_as_long_as_its_chord() -> None:
    off_axis_mm = np.array([0.0, 0.5, 0.9, 1.1])
    points = np.column_stack([np.zeros(4), off_axis_mm, np.full(4, 700.0)])
    expected = 2.0 * np.sqrt(np.maximum(1.0 - off_axis_mm**2, 0.0))
    assert path_mm(ACROSS, points) == pytest.approx(expected, abs=2e-3)


def test_it_ends_where_it_ends() -> None:
    x = np.array([-20.2, -19.8, 29.8, 30.2])
    points = np.column_stack([x, np.zeros(4), np.full(4, 700.0)])
    assert (path_mm(ACROSS, points) > 1.0).tolist() == [False, True, True, False]


def test_a_rod_along_the_beam_is_as_long_as_it_is() -> None:
    points = np.array([[0.0, 0.0, 620.0], [0.9, 0.0, 640.0], [1.1, 0.0, 600.0]])
    assert path_mm(ALONG, points) == pytest.approx([40.0, 40.0, 0.0], abs=2e-4)


def test_paths_of_several_rods_add_up() -> None:
    out = np.zeros(1)
    for rod in (ACROSS, ALONG):
        add_rod_path(np.zeros((1, 2)), rod, out)
    assert out == pytest.approx([42.0])


def test_its_discs_cover_its_image() -> None:
    discs = ACROSS.discs_px(calibration(640), wider_mm=0.5)
    middle = 0.5 * (640 - 1)
    assert discs[[0, -1], 0] - middle == pytest.approx(np.array([-20.0, 30.0]) * FOCAL_PX / 700.0)
    assert discs[:, 2] == pytest.approx(1.5 * FOCAL_PX / 700.0)
