"""Balls and the guide's body are looked at at places spread as their penumbra at their own depth."""

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.nail.occluders import Occluders, PlacedGuide, delrin_path_mm, steel_path_mm
from services.registration.core.nail.penumbra import Penumbra
from services.registration.core.nail.pixel_rays import SAMPLES_PX, PixelRays
from shared.geometry.frames import Camera, Guide
from shared.geometry.parts import BallPattern, Box, GuidePart
from shared.geometry.transform import Transform
from tests.unit.services.registration.rendered_case import CAMERA_FROM_GUIDE, CAMERA_FROM_NAIL, rendered_parts
from tests.unit.services.registration.xray_scene import FOCAL_PX, RING_DEPTH_MM, calibration

PARTS, VIEW = rendered_parts(), calibration(512)
PENUMBRA = Penumbra.beside(VIEW, float(CAMERA_FROM_NAIL.translation_mm[2]), 1.0)


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
    path_mm = delrin_path_mm(rays, Occluders(PlacedGuide(plate, pose), None), PENUMBRA)
    leaves = -np.diff(path_mm) / (path_mm[0] - path_mm[-1])
    middle = 0.5 * (off_px[1:] + off_px[:-1])
    variance = leaves @ middle**2 - (leaves @ middle) ** 2
    assert variance == pytest.approx(expected_spread(depth_mm) ** 2 / 12.0, rel=0.02)
