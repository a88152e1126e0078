"""How the window looks, and that its derivatives are those of the picture."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from services.registration.core.estimation.pose_estimate import POSE_SIZE
from services.registration.core.nail.derivatives import derivatives_by_hole_turns, visible_fraction_derivatives
from services.registration.core.nail.forward_model import ForwardModel, model_at, trace_transmission, visible_fraction
from services.registration.core.nail.imaging_chain import blurred_image
from services.registration.core.nail.noise import noise_correlation, whitening_filter
from services.registration.core.nail.parameters import (
    PARAMETER_COUNT,
    Parameter,
    clipped_to_bounds,
    parameters_from_pose,
    prior_mean,
)
from services.registration.core.nail.region import FitInput
from services.registration.core.tuning import FINAL_STAGE
from shared.geometry.lines import Line
from shared.geometry.parts import across_holes
from tests.accuracy.registration.nail.fluoroscope import nail_part, posed, shoot

_OF_ALL_BUT_SHAPE = tuple(Parameter)[Parameter.LOG_ATTENUATION : Parameter.DELRIN_PER_MM + 1]
# Not the step of the differences that are tested.
_OWN_STEP = 0.004


@cache
def model_at_truth() -> tuple[ForwardModel, np.ndarray]:
    truth = posed(3.0, -4.0, 20.0)
    shot = shoot(nail_part("Ti6Al4V", 11.0, 5.3, 4.5), truth, (1.0, -1.0), 3)
    given = FitInput(shot.pixels, shot.calibration, shot.nail, shot.occluders)
    model = model_at(given, truth, FINAL_STAGE, 1)
    assert model is not None
    parameters = prior_mean()
    parameters[:POSE_SIZE] = parameters_from_pose(truth, model.camera, model.anchors)
    return model, parameters


def scene_and_parameters() -> tuple[ForwardModel, np.ndarray]:
    model, parameters = model_at_truth()
    return model, parameters.copy()


def plain() -> ForwardModel:
    return scene_and_parameters()[0]


@cache
def filtered() -> ForwardModel:
    """The scene with a filter against noise that the detector has blurred in bright places only."""
    model = plain()
    shape, everywhere = model.region.shape, np.arange(model.region.grey.size)
    white = np.random.default_rng(5).normal(size=shape)
    dark, bright = (noise_correlation(n.ravel(), everywhere, shape) for n in (white, blurred_image(white, 0.9)))
    return replace(model, whitening=whitening_filter(dark, bright, np.clip(model.region.grey, 0.0, 1.0)))


@pytest.mark.parametrize("prepared", [plain, filtered], ids=["plain", "filtered"])
@pytest.mark.parametrize("unknown", _OF_ALL_BUT_SHAPE, ids=lambda unknown: unknown.name.lower())
def test_derivatives_are_those_of_the_picture(unknown: Parameter, prepared: Callable[[], ForwardModel]) -> None:
    _, parameters = scene_and_parameters()
    model = prepared()
    parameters[Parameter.LOG_SHARPENING_WIDTH_PX] = np.log(2.4)
    traced = trace_transmission(model, parameters)
    free = np.zeros(PARAMETER_COUNT, dtype=bool)
    free[unknown] = True
    (found,) = visible_fraction_derivatives(model, traced, free)
    sides = []
    for by in (_OWN_STEP, -_OWN_STEP):
        moved = parameters.copy()
        moved[unknown] += by
        sides.append(visible_fraction(model, trace_transmission(model, moved)))
    expected = (sides[0] - sides[1]) / (2.0 * _OWN_STEP)
    # single pixels jump where the number of rays through them changes: the whole is compared
    assert float(found @ expected) / float(expected @ expected) == pytest.approx(1.0, abs=0.01)
    assert np.corrcoef(found, expected)[0, 1] > 0.99


def test_derivatives_by_turns_of_the_holes_are_those_of_a_nail_drilled_askew() -> None:
    model, parameters = scene_and_parameters()
    found = derivatives_by_hole_turns(model, trace_transmission(model, parameters))
    turn = 0.002
    for axis, derivative in zip(across_holes(model.nail), found, strict=True):
        sides = []
        for by in (turn, -turn):
            holes = tuple(
                replace(
                    hole, axis=Line(hole.axis.point_mm, Rotation.from_rotvec(own * axis).apply(hole.axis.direction))
                )
                for hole, own in zip(model.nail.holes, (-0.5 * by, 0.5 * by), strict=True)
            )
            askew = replace(model, nail=replace(model.nail, holes=holes))
            sides.append(visible_fraction(askew, trace_transmission(askew, parameters)))
        expected = (sides[0] - sides[1]) / (2.0 * turn)
        assert float(derivative @ expected) / float(expected @ expected) == pytest.approx(1.0, abs=0.04)
        assert np.corrcoef(derivative, expected)[0, 1] > 0.99


def test_light_that_spreads_further_makes_a_hole_brighter_outside_and_darker_inside() -> None:
    model, parameters = scene_and_parameters()
    parameters[Parameter.SHARPENING] = 0.0
    shares = []
    for tail in (0.0, 0.4):
        parameters[Parameter.TAIL_SHARE] = tail
        shares.append(visible_fraction(model, trace_transmission(model, parameters)))
    without, with_tail = shares
    dark = without.min() + 0.02
    assert np.all((with_tail - without)[without < dark] > -1e-6)
    assert (with_tail - without)[without < dark].max() > 0.01
    assert (with_tail - without)[without > 0.98].min() < -0.01


def test_a_tail_stays_a_share() -> None:
    parameters = prior_mean()
    parameters[Parameter.TAIL_SHARE] = -0.5
    assert clipped_to_bounds(parameters)[Parameter.TAIL_SHARE] == 0.0


def test_a_curve_that_became_straight_finds_its_way_back() -> None:
    model, parameters = scene_and_parameters()
    parameters[Parameter.CURVE] = -0.2
    parameters = clipped_to_bounds(parameters)
    assert parameters[Parameter.CURVE] == 0.0
    traced = trace_transmission(model, parameters)
    free = np.zeros(PARAMETER_COUNT, dtype=bool)
    free[Parameter.CURVE] = True
    (found,) = visible_fraction_derivatives(model, traced, free)
    assert np.abs(found).max() > 0.1


def test_a_curve_is_a_power_of_the_intensity() -> None:
    """Half of the X-rays on a display that shows the intensity's root, between two known grey values."""
    model, parameters = scene_and_parameters()
    exponent, dark, bright = 0.5, 0.3, 0.9
    parameters[Parameter.CURVE_EXPONENT] = exponent
    parameters[Parameter.CURVE] = 0.5 * (1.0 - exponent) * np.log(bright / dark) / exponent
    parameters[Parameter.SHARPENING] = parameters[Parameter.TAIL_SHARE] = 0.0
    without_guide = replace(model.region, delrin_excess_mm=np.zeros(model.region.shape))
    model = replace(model, region=without_guide)
    traced = trace_transmission(model, parameters)
    half = np.full_like(traced.transmission, 0.5)
    found = visible_fraction(model, type(traced)(parameters, half, traced.derivatives))
    grey = np.sqrt(0.5 * (dark**2 + bright**2))
    assert found == pytest.approx((grey - dark) / (bright - dark), rel=1e-6)
