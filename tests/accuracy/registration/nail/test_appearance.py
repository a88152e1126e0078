"""How the window looks, and that its derivatives are those of the picture."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from services.registration.core.nail.forward_model import (
    Detail,
    Given,
    NailScene,
    derivatives_of_share,
    paths,
    scene_at,
    visible_share,
)
from services.registration.core.nail.imaging_chain import Scale, blurred_image
from services.registration.core.nail.least_squares import EVERYTHING
from services.registration.core.nail.noise import correlation_of, whitening_for
from services.registration.core.nail.parameters import (
    POSE_SIZE,
    Unknown,
    parameters_from_pose,
    prior_mean,
    within_reason,
)
from tests.accuracy.registration.nail.fluoroscope import nail_part, posed, shoot

_OF_ALL_BUT_SHAPE = tuple(Unknown)[Unknown.LOG_ATTENUATION : Unknown.DELRIN_PER_MM + 1]
# Not the step of the differences that are tested.
_OWN_STEP = 0.004


def scene_and_parameters() -> tuple[NailScene, np.ndarray]:
    truth = posed(3.0, -4.0, 20.0)
    shot = shoot(nail_part("Ti6Al4V", 11.0, 5.3, 4.5), truth, (1.0, -1.0), 3)
    given = Given(shot.pixels, shot.calibration, shot.nail, shot.occluders)
    scene = scene_at(given, truth, Detail(Scale(1, 0.0), 3.5, 1.5, 0.015))
    assert scene is not None
    parameters = prior_mean()
    parameters[:POSE_SIZE] = parameters_from_pose(truth, scene.camera, scene.anchors)
    return scene, parameters


def filtered(scene: NailScene) -> NailScene:
    """The scene with a filter against noise that the detector has blurred in bright places only."""
    shape, everywhere = scene.window.shape, np.arange(scene.window.grey.size)
    white = np.random.default_rng(5).normal(size=shape)
    dark, bright = (correlation_of(n.ravel(), everywhere, shape) for n in (white, blurred_image(white, 0.9)))
    return replace(scene, whitening=whitening_for(dark, bright, np.clip(scene.window.grey, 0.0, 1.0)))


@pytest.mark.parametrize("prepared", [lambda scene: scene, filtered], ids=["plain", "filtered"])
@pytest.mark.parametrize("unknown", _OF_ALL_BUT_SHAPE, ids=lambda unknown: unknown.name.lower())
def test_derivatives_are_those_of_the_picture(unknown: Unknown, prepared: Callable[[NailScene], NailScene]) -> None:
    scene, parameters = scene_and_parameters()
    scene = prepared(scene)
    parameters[Unknown.LOG_SHARPENING_WIDTH_PX] = np.log(2.4)
    traced = paths(scene, parameters)
    free = np.zeros_like(EVERYTHING)
    free[unknown] = True
    (found,) = derivatives_of_share(scene, traced, free)
    sides = []
    for by in (_OWN_STEP, -_OWN_STEP):
        moved = parameters.copy()
        moved[unknown] += by
        sides.append(visible_share(scene, paths(scene, moved)))
    expected = (sides[0] - sides[1]) / (2.0 * _OWN_STEP)
    # single pixels jump where the number of rays through them changes: the whole is compared
    assert float(found @ expected) / float(expected @ expected) == pytest.approx(1.0, abs=0.01)
    assert np.corrcoef(found, expected)[0, 1] > 0.99


def test_light_that_spreads_further_makes_a_hole_brighter_outside_and_darker_inside() -> None:
    scene, parameters = scene_and_parameters()
    parameters[Unknown.SHARPENING] = 0.0
    shares = []
    for tail in (0.0, 0.4):
        parameters[Unknown.TAIL_SHARE] = tail
        shares.append(visible_share(scene, paths(scene, parameters)))
    without, with_tail = shares
    dark = without.min() + 0.02
    assert np.all((with_tail - without)[without < dark] > -1e-6)
    assert (with_tail - without)[without < dark].max() > 0.01
    assert (with_tail - without)[without > 0.98].min() < -0.01


def test_a_tail_stays_a_share() -> None:
    parameters = prior_mean()
    parameters[Unknown.TAIL_SHARE] = -0.5
    assert within_reason(parameters)[Unknown.TAIL_SHARE] == 0.0


def test_a_curve_that_became_straight_finds_its_way_back() -> None:
    scene, parameters = scene_and_parameters()
    parameters[Unknown.CURVE] = -0.2
    parameters = within_reason(parameters)
    assert parameters[Unknown.CURVE] == 0.0
    traced = paths(scene, parameters)
    free = np.zeros_like(EVERYTHING)
    free[Unknown.CURVE] = True
    (found,) = derivatives_of_share(scene, traced, free)
    assert np.abs(found).max() > 0.1


def test_a_curve_is_a_power_of_the_intensity() -> None:
    """Half of the X-rays on a display that shows the intensity's root, between two known grey values."""
    scene, parameters = scene_and_parameters()
    exponent, dark, bright = 0.5, 0.3, 0.9
    parameters[Unknown.CURVE_EXPONENT] = exponent
    parameters[Unknown.CURVE] = 0.5 * (1.0 - exponent) * np.log(bright / dark) / exponent
    parameters[Unknown.SHARPENING] = parameters[Unknown.TAIL_SHARE] = 0.0
    without_guide = replace(scene.window, delrin_excess_mm=np.zeros(scene.window.shape))
    scene = replace(scene, window=without_guide)
    traced = paths(scene, parameters)
    half = np.full_like(traced.passed, 0.5)
    found = visible_share(scene, type(traced)(parameters, half, traced.by_cause))
    grey = np.sqrt(0.5 * (dark**2 + bright**2))
    assert found == pytest.approx((grey - dark) / (bright - dark), rel=1e-6)
