"""The paper's balls: found by circles and correlation, their centres to a fraction of a pixel."""

import numpy as np

from baselines.fronto_parallel.balls import find_balls
from tests.unit.services.registration.xray_scene import FOCAL_PX, Scene, calibration, render

SIZE_PX = 420
EVERYWHERE = np.ones((SIZE_PX, SIZE_PX), dtype=bool)
RADII_PX = (3.5, 8.0)


def grid_of_balls() -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Centres in the camera's frame (mm) and diameters of 25 balls, shape (25, 4)."""
    x, y = np.meshgrid(np.linspace(-32.0, 32.0, 5), np.linspace(-32.0, 32.0, 5))
    x, y = x + 0.37 * np.arange(25).reshape(5, 5) / 5.0, y - 0.21 * np.arange(25).reshape(5, 5) / 5.0
    return np.column_stack([x.ravel(), y.ravel(), np.full(25, 850.0), np.full(25, 2.0)])


def test_balls_are_found_where_they_are() -> None:
    view, balls = calibration(SIZE_PX), grid_of_balls()
    found = find_balls(render(Scene(SIZE_PX, balls=balls), view, seed=3), EVERYWHERE, RADII_PX)
    true_px = view.image_from_camera(balls[:, :3])
    off = np.linalg.norm(true_px[:, None] - found.centre_px[None], axis=-1).min(axis=1)
    assert np.count_nonzero(off < 1.0) >= 24
    assert np.median(off) < 0.15
    assert np.median(found.radius_px) > 0.7 * FOCAL_PX / 850.0
    assert (found.ring_index == -1).all()


def test_overlapped_balls_are_fitted_by_what_is_seen_of_them() -> None:
    view, balls = calibration(SIZE_PX), grid_of_balls()
    neighbour = balls[12] + np.array([1.65, 0.3, 0.0, 0.0])
    found = find_balls(render(Scene(SIZE_PX, balls=np.vstack([balls, neighbour])), view, seed=4), EVERYWHERE, RADII_PX)
    true_px = view.image_from_camera(np.vstack([balls[12, :3], neighbour[:3]]))
    off = np.linalg.norm(true_px[:, None] - found.centre_px[None], axis=-1).min(axis=1)
    assert (off < 1.0).all()


def test_hardly_anything_else_is_taken_for_a_ball() -> None:
    view, balls = calibration(SIZE_PX), grid_of_balls()
    found = find_balls(render(Scene(SIZE_PX, balls=balls), view, seed=5), EVERYWHERE, RADII_PX)
    true_px = view.image_from_camera(balls[:, :3])
    off = np.linalg.norm(true_px[:, None] - found.centre_px[None], axis=-1).min(axis=0)
    assert np.count_nonzero(off > 2.0) < 3
