"""A display that burns out where the guide is: wires seem to thin out and end there, and are not believed to."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.wires.image import RegisteredImage, saturated
from tests.unit.services.registration.core.wires.wire_scene import (
    ASKEW,
    LATERAL,
    assert_explains,
    oblique,
    verified,
    view_of,
)

OBLIQUE = oblique(38.0)


def towards_the_guide(view: RegisteredImage, along_mm: float) -> NDArray[np.float64]:
    """By how much each pixel is beyond a place on the drill's axis, on the surgeon's side, in mm along that axis."""
    here, outwards = (view.camera_from_guide @ np.array([0.0, 0.0, z]) for z in (along_mm, along_mm - 1.0))
    place, beyond = view.calibration.image_from_camera(np.stack([here, outwards]))
    per_mm_px = beyond - place
    y, x = np.mgrid[: view.pixels.shape[0], : view.pixels.shape[1]]
    away = np.stack([x, y], axis=-1) - place
    return np.asarray(away @ per_mm_px / (per_mm_px @ per_mm_px))


def burnt(view: RegisteredImage, along_mm: float) -> RegisteredImage:
    """The same brighter and brighter towards the guide, cut off at the image's white."""
    beyond = np.clip(towards_the_guide(view, along_mm), 0.0, None)
    white = float(np.percentile(view.pixels, 99.5))
    return replace(view, pixels=np.minimum(view.pixels * (1.0 + 0.08 * beyond), white).astype(np.float32))


@pytest.mark.long
@pytest.mark.parametrize("along_mm", [60.0, 75.0])
def test_a_wire_that_fades_into_white_is_not_taken_to_end_there(along_mm: float) -> None:
    result = verified(view_of(LATERAL, ASKEW, seed=51), burnt(view_of(OBLIQUE, ASKEW, seed=52), along_mm))
    assert [wire.hole.id for wire in result.wires] == ["distal", "proximal"]
    for wire in result.wires:
        assert_explains(wire, ASKEW, sigmas=2.5)


def test_what_is_white_and_what_borders_on_it_shows_no_wire() -> None:
    view = burnt(view_of(OBLIQUE, ASKEW, seed=53), 75.0)
    hidden = saturated(view)
    beyond = towards_the_guide(view, 75.0)
    white = view.pixels == view.pixels.max()
    assert np.mean(hidden[white & (beyond > 30.0)]) > 0.99
    # but for the brightest of the texture
    assert np.mean(hidden[beyond < -10.0]) < 0.05
    # a wire as wide as 2 mm, white on both sides, is hidden whole
    assert hidden[beyond > 40.0].all()


def test_an_image_that_is_nowhere_saturated_hides_nothing() -> None:
    assert not saturated(view_of(OBLIQUE, ASKEW, seed=54)).any()
