"""The fit's stages, coarse to fine: what each one looks at, with which freedom, and how it weighs the pixels."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.blur import blurred_image
from services.registration.core.nail.equations import Linear, Problem, solution_for
from services.registration.core.nail.noise import (
    Correlation,
    correlation_of,
    robust_weight,
    variance_by_brightness,
    whitening_for,
)
from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.pose import anchors_of
from services.registration.core.nail.scene import NailScene, nail_scene
from services.registration.core.nail.texture import spline_field
from services.registration.core.nail.unknowns import PARAMETERS
from services.registration.core.nail.window import Scale, Window, cut_window
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform
from shared.two_cores import mapped

EVERYTHING = np.ones(PARAMETERS, dtype=bool)
_ASSUMED_NOISE = 0.025
_CLIPPED_DEVIATIONS = 4.0
_BRIGHTNESS_BLUR_PX = 1.5
_LEAST_OF_A_KIND = 400


@dataclass(frozen=True, slots=True, eq=False)
class Given:
    """What a fit is given."""

    pixels: NDArray[np.float32]
    calibration: CArmCalibration
    nail: NailPart
    occluders: Occluders


@dataclass(frozen=True, slots=True)
class Detail:
    """How finely a stage looks: pixels, surroundings of the holes, knots of the background and its roughness.

    `texture` is the standard deviation of second differences between the background's knots, in units of the
    window's brightness.
    """

    scale: Scale
    surroundings_mm: float
    knots_mm: float
    texture: float


@dataclass(frozen=True, slots=True, eq=False)
class Noise:
    """Residuals of a fit as noise.

    Attributes
    ----------
    variance
        Per compared pixel, shape (N,).
    brightness
        From metal (0) to background (1) on the whole rectangle, shape (rows, columns).
    dark, bright
        Correlation of the standardised residuals between pixels of either kind.
    inflation
        Of the pixels' variance, by their brightness, shape (N,).
    """

    variance: NDArray[np.float64]
    brightness: NDArray[np.float64]
    dark: Correlation
    bright: Correlation
    inflation: NDArray[np.float64]


def scene_at(given: Given, camera_from_nail: Transform[Camera, Nail], detail: Detail) -> NailScene | None:
    """Window around a pose; `None` when the nail's holes are not in the image."""
    window = cut_window(
        given.pixels,
        given.calibration,
        given.nail,
        detail.surroundings_mm,
        camera_from_nail,
        given.occluders,
        detail.scale,
    )
    if window is None:
        return None
    anchors = anchors_of(given.nail)
    return nail_scene(window, given.calibration.camera, anchors, given.nail)


def problem_for(scene: NailScene, detail: Detail, free: NDArray[np.bool_]) -> Problem:
    """Least-squares problem with the same weight for all pixels."""
    window = scene.window
    field = spline_field(window.along_mm, window.across_mm, detail.knots_mm)
    weight = np.full(len(window.compared), _ASSUMED_NOISE**-2)
    return Problem(scene, field, scene.grey, _floor_basis(window), weight, detail.texture**-2, free)


def noise_of(problem: Problem, linear: Linear) -> Noise:
    """Variance and correlation of the residuals."""
    residual = linear.residual
    window = problem.scene.window
    variance = variance_by_brightness(residual, problem.grey - residual)
    standardised = np.clip(residual / np.sqrt(variance), -_CLIPPED_DEVIATIONS, _CLIPPED_DEVIATIONS)
    brightness = np.clip(blurred_image(linear.traced.passed, _BRIGHTNESS_BLUR_PX), 0.0, 1.0)
    here = brightness.ravel()[window.compared]

    def of_kind(kind: NDArray[np.bool_]) -> Correlation:
        enough = kind if np.count_nonzero(kind) >= _LEAST_OF_A_KIND else np.ones_like(kind)
        return correlation_of(standardised[enough], window.compared[enough], window.shape)

    dark, bright = mapped(of_kind, (here < 0.5, here >= 0.5), 2)
    inflation = (1.0 - here) * dark.inflation + here * bright.inflation
    return Noise(variance, brightness, dark, bright, inflation)


def reweighted(problem: Problem, linear: Linear, noise: Noise) -> Problem:
    """The same problem with every pixel weighed by its variance, outliers less.

    Divided by the inflation, the cost counts independent samples: only then do priors have their due weight.
    """
    weight = robust_weight(linear.residual, noise.variance) / noise.inflation
    return replace(problem, weight=weight)


def evenly_weighted(problem: Problem, noise: Noise) -> Problem:
    """The same problem with every pixel weighed by its variance, outliers as all others."""
    return replace(problem, weight=1.0 / (noise.variance * noise.inflation))


def whitened(problem: Problem, linear: Linear, noise: Noise) -> tuple[Problem, Linear]:
    """The same problem on the image after the filter that makes its noise about independent, weights renewed.

    Also its solution, found with the old weights.
    """
    whitening = whitening_for(noise.dark, noise.bright, noise.brightness)
    scene = replace(problem.scene, whitening=whitening)
    filtered = replace(problem, scene=scene, grey=scene.grey)
    after = solution_for(filtered, linear.traced)
    return reweighted(filtered, after, noise_of(filtered, after)), after


def _floor_basis(window: Window) -> NDArray[np.float64]:
    """Grey value behind closed metal: scatter and glare vary slowly, like a quadratic in the strip, shape (N, 6)."""
    x, y = window.along_mm / 20.0, window.across_mm / 6.0
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
