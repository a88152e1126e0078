"""The femur's tube against closed forms."""

import numpy as np
import pytest

from simulation.render.femur import flare, tube

# Flare from x = -30 to 30; half-axes 14 (y) and 12 (z) in the shaft, 20 and 30 after the flare.
ROW = np.array([-30.0, 30.0, 14.0, 20.0, 12.0, 30.0, -300.0, 60.0])


def chord(x: float, y: float, direction: np.ndarray | None = None) -> float:
    d = np.array([0.0, 0.0, 1.0]) if direction is None else direction
    near, far = tube(ROW, np.array([x, y, 0.0]) - 100.0 * d, d)
    return max(0.0, far - near)


@pytest.mark.parametrize(("x", "y", "a", "b"), [(-80.0, 7.0, 14.0, 12.0), (45.0, 10.0, 20.0, 30.0)])
def test_straight_parts_have_an_ellipse_as_section(x: float, y: float, a: float, b: float) -> None:
    assert chord(x, y) == pytest.approx(2.0 * b * np.sqrt(1.0 - (y / a) ** 2))


def test_in_the_flare_the_section_is_that_of_the_place() -> None:
    s = flare(10.0, -30.0, 30.0)
    a, b = 14.0 + s * 6.0, 12.0 + s * 18.0
    assert chord(10.0, 5.0) == pytest.approx(2.0 * b * np.sqrt(1.0 - (5.0 / a) ** 2))


def test_an_oblique_ray_ends_on_the_surface() -> None:
    direction = np.array([0.15, 0.05, 1.0])
    origin = np.array([0.0, 4.0, 0.0]) - 100.0 * direction
    for t in tube(ROW, origin, direction):
        x, y, z = origin + t * direction
        s = flare(x, -30.0, 30.0)
        assert (y / (14.0 + s * 6.0)) ** 2 + (z / (12.0 + s * 18.0)) ** 2 == pytest.approx(1.0, abs=2e-3)


def test_it_is_missed_beside_and_beyond() -> None:
    assert chord(-80.0, 14.1) == 0.0
    assert chord(61.0, 0.0) == 0.0
