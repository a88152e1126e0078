"""Tails of the guide's balls: there where earlier frames are in the image and something moved, and only there."""

from dataclasses import replace
from importlib.resources import files

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from services.registration.core.guide.lag import beyond_chance_px
from services.registration.core.guide.locate import locate_guide
from shared.errors import Accepted
from shared.geometry.frames import Camera, Guide
from shared.geometry.parts import BallPattern, GuidePart, RingPart
from shared.geometry.transform import Transform
from shared.parts.files import guide_from_json
from shared.xray.detection import detect_balls
from tests.unit.services.registration.xray_scene import Scene, calibration, render

SIZE_PX, DEPTH_MM = 640, 640.0
NO_RING = RingPart(BallPattern((), np.zeros((0, 3)), np.zeros(0)), (), "0" * 64)
# The newest frame has most weight.
WEIGHTS = (0.6, 0.24, 0.1, 0.06)


@pytest.fixture(scope="module")
def guide() -> GuidePart:
    return guide_from_json(files("shared.parts").joinpath("catalogue/guide-28.json").read_bytes())


def frame(guide: GuidePart, aside_mm: float, seed: int) -> NDArray[np.float32]:
    """An image of the guide, moved to one side."""
    rotation = Rotation.from_euler("ZXY", (40.0, 3.0, 2.0), degrees=True).as_matrix()
    pose: Transform[Camera, Guide] = Transform.from_rotation_translation(rotation, np.array([aside_mm, 0.0, DEPTH_MM]))
    balls = np.column_stack([pose.points(guide.balls.position_mm), guide.balls.diameter_mm])
    return render(Scene(SIZE_PX, balls=balls), calibration(SIZE_PX), seed)


def averaged(guide: GuidePart, step_mm: float) -> NDArray[np.float32]:
    frames = [frame(guide, step_mm * number, seed=number) for number in range(len(WEIGHTS))]
    return np.asarray(np.average(frames, axis=0, weights=WEIGHTS), dtype=np.float32)


def lag_of(pixels: NDArray[np.float32], guide: GuidePart) -> float:
    found = replace(calibration(SIZE_PX), balls=detect_balls(pixels, np.ones(pixels.shape, dtype=bool), (3.5, 9.0)))
    located = locate_guide(pixels, found, NO_RING, guide)
    assert isinstance(located, Accepted), located
    return located.value.lag_px


@pytest.mark.parametrize("seed", range(4))
def test_a_single_frame_has_no_tail(guide: GuidePart, seed: int) -> None:
    assert lag_of(frame(guide, 0.0, seed), guide) == 0.0


def test_frames_of_what_stands_still_have_none(guide: GuidePart) -> None:
    assert lag_of(averaged(guide, 0.0), guide) == 0.0


def test_the_tail_grows_with_the_movement_between_frames(guide: GuidePart) -> None:
    little, much = (lag_of(averaged(guide, step_mm), guide) for step_mm in (0.2, 0.35))
    assert 0.05 < little < much


def test_a_slope_of_the_background_is_no_tail(guide: GuidePart) -> None:
    """One in a hundred darker from column to column."""
    ramp = np.exp(-0.01 * np.arange(SIZE_PX))
    assert lag_of((frame(guide, 0.0, 1) * ramp).astype(np.float32), guide) < 0.03


def test_scatter_across_a_tail_does_not_hide_it() -> None:
    """A bone's edges displace some centroids to their own side: along the tail all agree."""
    aside = np.random.default_rng(3).normal(0.0, 1.0, 16)
    aside -= np.median(aside)
    along = 0.4 + 0.05 * np.random.default_rng(4).normal(0.0, 1.0, 16)
    turned = Rotation.from_euler("z", 0.6).as_matrix()[:2, :2]
    for rotation in (np.eye(2), turned):
        assert beyond_chance_px(np.column_stack([along, aside]) @ rotation.T) == pytest.approx(0.4, abs=0.05)
    assert beyond_chance_px(np.column_stack([aside + 0.4, aside])) == 0.0
