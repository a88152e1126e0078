"""What the pixels of the window should show: how much of the background each pixel sees past nail and balls.

The grey value of a pixel is  background * visible + floor * (1 - visible). `visible` follows from the metal on the
ray: transmission exp(-(mu * path)^power), blurred, bent by the display's curve, sharpened by edge enhancement.
"""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.blur import blurred_image
from services.registration.core.nail.noise import Whitening
from services.registration.core.nail.paths import mean_transmission
from services.registration.core.nail.pose import POSE_SIZE, Anchors, pose_from_parameters, rotation_and_translation
from services.registration.core.nail.window import SAMPLES_PX, Window
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform

_MOST_DEVIATIONS = 6.0
_MOST_RADIUS_EXCESS_MM = 0.6
_STRAIGHT = 1e-6
_USUAL_BLUR_PX = 1.2


class Unknown(IntEnum):
    """Place of each unknown in the parameter vector; the first six are the pose (`pose.py`)."""

    FIRST_X_PX = 0
    FIRST_Y_PX = 1
    SECOND_X_PX = 2
    SECOND_Y_PX = 3
    PITCH_RAD = 4
    ROLL_RAD = 5
    HOLE_RADIUS_EXCESS_MM = 6
    NAIL_RADIUS_EXCESS_MM = 7
    LOG_ATTENUATION = 8
    POWER = 9
    LOG_BLUR_PX = 10
    SHARPENING = 11
    LOG_SHARPENING_WIDTH_PX = 12
    CURVE = 13
    DELRIN_PER_MM = 14


PARAMETERS = len(Unknown)
LAST_GEOMETRIC = Unknown.NAIL_RADIUS_EXCESS_MM + 1

# Mean and standard deviation of what is known before the image is seen. Attenuation: effective values of 40-80 keV.
ATTENUATION_PER_MM = {"steel": 1.0, "Ti6Al4V": 0.33}
STEEL_IN_NAIL_MATERIAL = {"steel": 1.0, "Ti6Al4V": 3.2}
PRIOR = {
    Unknown.HOLE_RADIUS_EXCESS_MM: (0.0, 0.03),
    Unknown.NAIL_RADIUS_EXCESS_MM: (0.0, 0.03),
    Unknown.LOG_ATTENUATION: (0.0, 0.5),
    Unknown.POWER: (0.8, 0.2),
    Unknown.LOG_BLUR_PX: (float(np.log(_USUAL_BLUR_PX)), 0.35),
    Unknown.SHARPENING: (0.2, 0.4),
    Unknown.LOG_SHARPENING_WIDTH_PX: (float(np.log(2.5)), 0.4),
    Unknown.CURVE: (0.3, 0.3),
    Unknown.DELRIN_PER_MM: (0.02, 0.02),
}

# Steps of the numerical derivatives: about a tenth of a pixel at the rims, so that sub-pixel samples change by many.
STEP = np.array([0.1, 0.1, 0.1, 0.1, 0.004, 0.004, 0.02, 0.02, 0.02, 0.01, 0.02, 0.02, 0.05, 0.02, 0.001])


_RADII = (Unknown.HOLE_RADIUS_EXCESS_MM, Unknown.NAIL_RADIUS_EXCESS_MM)


def _reach_of(unknown: Unknown) -> float:
    """How far from its prior's mean a parameter may go; radii far enough to tell another nail."""
    if unknown not in PRIOR:
        return float("inf")
    return _MOST_RADIUS_EXCESS_MM if unknown in _RADII else _MOST_DEVIATIONS * PRIOR[unknown][1]


_REACH = np.array([_reach_of(unknown) for unknown in Unknown])


@dataclass(frozen=True, slots=True, eq=False)
class NailScene:
    """All that is fixed during a fit: the window, the camera and the nail's nominal shape.

    Attributes
    ----------
    body_mm
        Path in the guide's body at the compared pixels, blurred (and whitened) as the image is, shape (N,).
    contrast
        Step between background and floor, in units of the usual one, on the whole rectangle, shape of it.
    whitening
        Filter that image and model both go through.
    """

    window: Window
    camera: PinholeCamera
    anchors: Anchors
    nail: NailPart
    body_mm: NDArray[np.float64]
    contrast: NDArray[np.float64]
    whitening: Whitening | None

    def compared(self, image: NDArray[np.float64]) -> NDArray[np.float64]:
        """The strip's pixels of an image of the window, shape (N,), whitened when the scene says so."""
        return _compared(self.window, self.whitening, image)

    @property
    def grey(self) -> NDArray[np.float64]:
        """Measured grey values that the model is compared with, shape (N,)."""
        return self.compared(self.window.grey)

    def pose(self, parameters: NDArray[np.float64]) -> Transform[Camera, Nail]:
        """`camera_from_nail` that the parameters stand for."""
        return pose_from_parameters(parameters[:POSE_SIZE], self.camera, self.anchors)


def nail_scene(window: Window, camera: PinholeCamera, anchors: Anchors, nail: NailPart) -> NailScene:
    """Scene as it is before anything has been learned from a fit."""
    return NailScene(window, camera, anchors, nail, _body_mm(window, None), np.ones(window.shape), None)


def whitened_scene(scene: NailScene, whitening: Whitening) -> NailScene:
    """The same scene, to be compared after a filter."""
    return replace(scene, body_mm=_body_mm(scene.window, whitening), whitening=whitening)


def _compared(window: Window, whitening: Whitening | None, image: NDArray[np.float64]) -> NDArray[np.float64]:
    filtered = image if whitening is None else whitening.apply(image)
    return filtered.ravel()[window.compared]


def _body_mm(window: Window, whitening: Whitening | None) -> NDArray[np.float64]:
    """The guide's edges are weak: the usual blur is as good for them as the fitted one, and saves the time."""
    blur = float(np.hypot(_USUAL_BLUR_PX / window.reduction, window.smoothing))
    return _compared(window, whitening, blurred_image(window.delrin_mm, blur))


@dataclass(frozen=True, slots=True, eq=False)
class Appearance:
    """Per compared pixel, shape (N,): share of the background that is seen, and what the guide's body leaves of it."""

    visible: NDArray[np.float64]
    delrin: NDArray[np.float64]


def prior_mean() -> NDArray[np.float64]:
    """Shape (PARAMETERS,); zero for the pose."""
    return np.array([PRIOR[u][0] if u in PRIOR else 0.0 for u in Unknown])


def prior_precision() -> NDArray[np.float64]:
    """Inverse variances, shape (PARAMETERS,); zero for the pose."""
    return np.array([PRIOR[u][1] ** -2 if u in PRIOR else 0.0 for u in Unknown])


def within_reason(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """Nuisances clipped to where they still mean something, mostly six standard deviations of their prior."""
    return np.clip(parameters, prior_mean() - _REACH, prior_mean() + _REACH)


def transmission(scene: NailScene, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of the X-rays that pass the metal, mean over each pixel, on the whole rectangle, shape (rows, columns)."""
    window, nail = scene.window, scene.nail
    rotation, translation_mm = rotation_and_translation(parameters[:POSE_SIZE], scene.camera, scene.anchors)
    excess = parameters[Unknown.HOLE_RADIUS_EXCESS_MM]
    bores = np.array([(*h.axis.point_mm, *h.axis.direction, 0.5 * h.diameter_mm + excess) for h in nail.holes])
    passed = np.empty(len(window.support))
    mean_transmission(
        window.slopes,
        window.right,
        window.down,
        SAMPLES_PX,
        window.crossed,
        STEEL_IN_NAIL_MATERIAL[nail.material] * window.steel_mm,
        rotation,
        translation_mm,
        nail.radius_mm + parameters[Unknown.NAIL_RADIUS_EXCESS_MM],
        0.5 * nail.cannulation_diameter_mm,
        bores,
        ATTENUATION_PER_MM[nail.material] * np.exp(parameters[Unknown.LOG_ATTENUATION]),
        parameters[Unknown.POWER],
        passed,
    )
    out = np.ones(window.shape)
    out.ravel()[window.support] = passed
    return out


def appearance(scene: NailScene, parameters: NDArray[np.float64], passed: NDArray[np.float64]) -> Appearance:
    """Blur, display curve and edge enhancement on a transmission map (from `transmission`)."""
    window = scene.window
    blur = np.hypot(np.exp(parameters[Unknown.LOG_BLUR_PX]) / window.reduction, window.smoothing)
    width = np.exp(parameters[Unknown.LOG_SHARPENING_WIDTH_PX]) / window.reduction
    blurred = blurred_image(passed, float(blur))
    bent = _displayed(blurred, 2.0 * parameters[Unknown.CURVE] * scene.contrast)
    sharpening = parameters[Unknown.SHARPENING]
    visible = (1.0 + sharpening) * bent - sharpening * blurred_image(bent, float(width))
    delrin = np.exp(-parameters[Unknown.DELRIN_PER_MM] * scene.body_mm)
    return Appearance(scene.compared(visible), delrin)


def _displayed(share: NDArray[np.float64], step: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of the grey step that a share of the intensity step makes, on a logarithmic curve `step` long."""
    safe = np.where(np.abs(step) < _STRAIGHT, _STRAIGHT, step)
    return np.asarray(np.log1p(np.expm1(safe) * share) / safe)


def render(scene: NailScene, parameters: NDArray[np.float64]) -> Appearance:
    """Appearance from scratch."""
    return appearance(scene, parameters, transmission(scene, parameters))


_NEEDS_NO_NEW_PATHS = (
    Unknown.LOG_BLUR_PX,
    Unknown.SHARPENING,
    Unknown.LOG_SHARPENING_WIDTH_PX,
    Unknown.CURVE,
    Unknown.DELRIN_PER_MM,
)


def render_with_derivatives(
    scene: NailScene, parameters: NDArray[np.float64], free: NDArray[np.bool_]
) -> tuple[Appearance, list[Appearance]]:
    """Appearance and its derivatives by the free parameters (central differences), one `Appearance` each."""
    passed = transmission(scene, parameters)
    base = appearance(scene, parameters, passed)
    steps = STEP.copy()
    steps[:LAST_GEOMETRIC] *= scene.window.reduction
    derivatives = []
    for unknown in Unknown:
        if not free[unknown]:
            continue
        there, back = (_moved(scene, parameters, passed, unknown, side * steps[unknown]) for side in (0.5, -0.5))
        derivatives.append(
            Appearance((there.visible - back.visible) / steps[unknown], (there.delrin - back.delrin) / steps[unknown])
        )
    return base, derivatives


def _moved(
    scene: NailScene, parameters: NDArray[np.float64], passed: NDArray[np.float64], unknown: Unknown, by: float
) -> Appearance:
    """Appearance with one parameter moved; the transmission map is taken over where it does not depend on it."""
    moved = parameters.copy()
    moved[unknown] += by
    if unknown in _NEEDS_NO_NEW_PATHS:
        return appearance(scene, moved, passed)
    return render(scene, moved)
