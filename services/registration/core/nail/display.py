"""What detector and display make of the share that passes: blur, the display's curve, edge enhancement."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.blur import Real, blurred_image
from services.registration.core.nail.scene import NailScene
from services.registration.core.nail.unknowns import Unknown

_STRAIGHT = 1e-6
# One-sided: what the second derivative adds is below a per cent.
_STEP = 0.005
# Share of the grey value that may be gone on the way from dark to bright, for falling curves.
_LEAST_RISE = -0.9
# Of the usual grey value of the floor, counted from black.
_LEAST_FLOOR = 0.2
_MOST_CURVE = 5.0
_OF_BLUR = (Unknown.LOG_BLUR_PX, Unknown.TAIL_SHARE, Unknown.LOG_TAIL_WIDTH)
_OF_CURVE = (Unknown.CURVE, Unknown.CURVE_EXPONENT)
# All unknowns that act on the picture after the rays.
OF_DISPLAY = tuple(Unknown)[Unknown.LOG_BLUR_PX : Unknown.CURVE_EXPONENT + 1]


@dataclass(frozen=True, slots=True, eq=False)
class Stages:
    """The share that passes after each thing that happens to it, on the whole rectangle, shape of it."""

    blurred: NDArray[np.float64]
    bent: NDArray[np.float64]
    sharpened: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Display:
    """What happens to the intensity on its way to the grey value.

    The blur is a Gaussian with a wider one about it: light spreads further in a phosphor than its core does, and
    a tail that is not modelled passes for wider holes. The curve is a power of the intensity (a logarithm when
    `exponent` is 0), of which an edge shows the part from dark to bright: `curve` is the logarithm of their ratio,
    shape (rows, columns).
    """

    blur_px: float
    tail_share: float
    tail_px: float
    curve: NDArray[np.float64]
    exponent: float
    sharpening: float
    width_px: float

    def stages(self, passed: NDArray[np.float64]) -> Stages:
        """All that happens, one after the other."""
        blurred = self.blurred(passed)
        bent = self.bent(blurred)
        return Stages(blurred, bent, self.sharpened(bent))

    def blurred(self, image: NDArray[Real]) -> NDArray[Real]:
        """As the detector blurs the intensity."""
        core = blurred_image(image, self.blur_px)
        wide = blurred_image(core, float(np.sqrt(max(self.tail_px**2 - self.blur_px**2, 0.0))))
        return np.asarray(core + image.dtype.type(self.tail_share) * (wide - core), dtype=image.dtype)

    def bent(self, share: NDArray[np.float64]) -> NDArray[np.float64]:
        """Share of the grey step that a share of the intensity step makes."""
        brighter = np.log1p(np.expm1(self.curve) * share)
        return np.asarray(np.expm1(self.exponent * brighter) / np.expm1(self.exponent * self.curve))

    def slope(self, share: NDArray[np.float64]) -> NDArray[np.float64]:
        """Derivative of `bent` by the share."""
        rise = np.expm1(self.curve)
        steepness = np.exp((self.exponent - 1.0) * np.log1p(rise * share))
        return np.asarray(self.exponent * rise * steepness / np.expm1(self.exponent * self.curve))

    def sharpened(self, image: NDArray[Real]) -> NDArray[Real]:
        """Edge enhancement: what differs from the surroundings is enlarged."""
        return (1.0 + self.sharpening) * image - self.sharpening * blurred_image(image, self.width_px)


def display_of(scene: NailScene, parameters: NDArray[np.float64]) -> Display:
    """The display that the parameters stand for."""
    window = scene.window
    exponent = float(parameters[Unknown.CURVE_EXPONENT])
    if abs(exponent) < _STRAIGHT:
        exponent = _STRAIGHT
    # so that the bend hardly depends on the exponent
    usual_curve = 2.0 * parameters[Unknown.CURVE] / (1.0 - exponent)
    curve = _curve(scene, exponent, float(np.clip(usual_curve, _STRAIGHT, _MOST_CURVE)))
    blur_px, width = np.exp(parameters[[Unknown.LOG_BLUR_PX, Unknown.LOG_TAIL_WIDTH]])
    return Display(
        float(np.hypot(blur_px / window.reduction, window.smoothing)),
        float(parameters[Unknown.TAIL_SHARE]),
        float(np.hypot(width * blur_px / window.reduction, window.smoothing)),
        curve,
        exponent,
        float(parameters[Unknown.SHARPENING]),
        float(np.exp(parameters[Unknown.LOG_SHARPENING_WIDTH_PX])) / window.reduction,
    )


def _curve(scene: NailScene, exponent: float, usual: float) -> NDArray[np.float64]:
    """Logarithm of the intensities' ratio from dark to bright at every place, from that at the usual grey values.

    On a display that shows a power of the intensity, of an unknown zero, the ratio follows from the grey values: how
    far the usual step goes with the usual ratio tells where their zero lies.
    """
    rise = np.expm1(exponent * usual)
    ratio = rise * scene.step / np.maximum(1.0 + rise * scene.floor_excess, _LEAST_FLOOR)
    return np.asarray(np.log1p(np.maximum(ratio, _LEAST_RISE)) / exponent)


def derivative_of_display(
    unknown: Unknown,
    scene: NailScene,
    parameters: NDArray[np.float64],
    passed: NDArray[np.float64],
    before: Stages,
) -> NDArray[np.float32]:
    """Derivative of the visible share by one of the display's parameters: a difference, from where it first acts."""
    moved = parameters.copy()
    moved[unknown] += _STEP
    display = display_of(scene, moved)
    bent = before.bent
    if unknown in _OF_BLUR:
        bent = display.bent(display.blurred(passed))
    elif unknown in _OF_CURVE:
        bent = display.bent(before.blurred)
    return np.asarray((display.sharpened(bent) - before.sharpened) / _STEP, dtype=np.float32)
