"""What the pixels of the window should show: how much of the background each pixel sees past nail and balls.

The grey value of a pixel is  background * visible + floor * (1 - visible). `visible` follows from the metal on the
ray: transmission exp(-(mu * path)^power), blurred, bent by the display's curve, sharpened by edge enhancement.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.blur import Real, blurred_image
from services.registration.core.nail.pixel_rays import SAMPLES_PX, PixelRays
from services.registration.core.nail.pose import POSE_SIZE, motion_by_parameters, rotation_and_translation
from services.registration.core.nail.scene import NailScene
from services.registration.core.nail.shade import DERIVATIVES, MOTION_SIZE
from services.registration.core.nail.transmission import NailShape, trace
from services.registration.core.nail.unknowns import (
    ATTENUATION_PER_MM,
    STATED_CHAMFER_SD_MM,
    STEEL_IN_NAIL_MATERIAL,
    USUAL_CHAMFER_MM,
    USUAL_CHAMFER_SD_MM,
    Unknown,
)
from services.registration.core.nail.window import Window
from shared.geometry.parts import Hole, NailPart
from shared.two_cores import mapped, on_both_halves

_STRAIGHT = 1e-6
# One-sided: what the second derivative adds is below a per cent.
_STEP = 0.005
# Share of the grey value that may be gone on the way from dark to bright, for falling curves.
_LEAST_RISE = -0.9
# Of the usual grey value of the floor, counted from black.
_LEAST_FLOOR = 0.2
_MOST_CURVE = 5.0
# Fewer are done sooner than handed to another core.
_LEAST_RAYS, _LEAST_PICTURES = 1000, 2
# Unknowns in the order of the kernel's derivatives, then those that act on the picture afterwards.
_OF_PATHS = tuple(Unknown)[: Unknown.POWER + 1]
_OF_BLUR = (Unknown.LOG_BLUR_PX, Unknown.TAIL_SHARE, Unknown.LOG_TAIL_WIDTH)
_OF_CURVE = (Unknown.CURVE, Unknown.CURVE_EXPONENT)
_OF_DISPLAY = tuple(Unknown)[Unknown.LOG_BLUR_PX : Unknown.CURVE_EXPONENT + 1]


@dataclass(frozen=True, slots=True, eq=False)
class Appearance:
    """Per compared pixel, shape (N,): share of the background that is seen, and what the guide's body leaves of it."""

    visible: NDArray[np.float64]
    delrin: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Paths:
    """What the rays meet: share that passes, on the whole rectangle, and its derivatives on the support.

    Attributes
    ----------
    parameters
        For which the rays were traced.
    passed
        Share of the X-rays that pass the metal, mean over each pixel, shape (rows, columns).
    by_cause
        Its derivatives by the causes of `transmission.py`, shape (S, DERIVATIVES).
    """

    parameters: NDArray[np.float64]
    passed: NDArray[np.float64]
    by_cause: NDArray[np.float64]


def paths(scene: NailScene, parameters: NDArray[np.float64]) -> Paths:
    """Trace all rays of the window."""
    window, count = scene.window, len(scene.window.support)
    passed, by_cause = np.empty(count), np.empty((count, DERIVATIVES))
    steel_mm = STEEL_IN_NAIL_MATERIAL[scene.nail.material] * window.steel_mm
    shape = _nail_shape(scene, parameters)

    def trace_part(part: slice) -> None:
        rays = PixelRays(*(of_all[part] for of_all in window.rays))
        trace(rays, SAMPLES_PX, window.crossed[part], steel_mm[part], shape, passed[part], by_cause[part])

    on_both_halves(trace_part, count, _LEAST_RAYS)
    return Paths(parameters, _on_rectangle(window, passed, 1.0), by_cause)


def render(scene: NailScene, traced: Paths) -> Appearance:
    """How the window looks."""
    display = _display(scene, traced.parameters)
    delrin = np.exp(-traced.parameters[Unknown.DELRIN_PER_MM] * scene.body_mm)
    return Appearance(scene.compared(display.stages(traced.passed).sharpened), delrin)


def derivatives(scene: NailScene, traced: Paths, look: Appearance, free: NDArray[np.bool_]) -> list[Appearance]:
    """Derivatives of the appearance by the free parameters, in their order; in single precision, which is plenty."""
    display = _display(scene, traced.parameters)
    stages = display.stages(traced.passed)
    slope = display.slope(stages.blurred).astype(np.float32)
    by_paths = mapped(
        lambda p: display.sharpened(slope * display.blurred(p)),
        _paths_derivatives(scene, traced, free),
        _LEAST_PICTURES,
    )
    by_display = mapped(
        lambda unknown: _display_derivative(unknown, scene, traced, stages),
        [unknown for unknown in _OF_DISPLAY if free[unknown]],
        _LEAST_PICTURES,
    )
    unchanged = np.zeros_like(look.visible)
    columns = [Appearance(visible, unchanged) for visible in scene.compared(np.stack([*by_paths, *by_display]))]
    if free[Unknown.DELRIN_PER_MM]:
        columns.append(Appearance(unchanged, -scene.body_mm * look.delrin))
    return columns


@dataclass(frozen=True, slots=True, eq=False)
class _Stages:
    """The share that passes after each thing that happens to it, on the whole rectangle, shape of it."""

    blurred: NDArray[np.float64]
    bent: NDArray[np.float64]
    sharpened: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class _Display:
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

    def stages(self, passed: NDArray[np.float64]) -> _Stages:
        """All that happens, one after the other."""
        blurred = self.blurred(passed)
        bent = self.bent(blurred)
        return _Stages(blurred, bent, self.sharpened(bent))

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


def _display(scene: NailScene, parameters: NDArray[np.float64]) -> _Display:
    window = scene.window
    exponent = float(parameters[Unknown.CURVE_EXPONENT])
    if abs(exponent) < _STRAIGHT:
        exponent = _STRAIGHT
    # so that the bend hardly depends on the exponent
    usual_curve = 2.0 * parameters[Unknown.CURVE] / (1.0 - exponent)
    curve = _curve(scene, exponent, float(np.clip(usual_curve, _STRAIGHT, _MOST_CURVE)))
    blur_px, width = np.exp(parameters[[Unknown.LOG_BLUR_PX, Unknown.LOG_TAIL_WIDTH]])
    return _Display(
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


def _paths_derivatives(scene: NailScene, traced: Paths, free: NDArray[np.bool_]) -> Iterator[NDArray[np.float32]]:
    """Derivatives of the transmission map by the free parameters that act on the paths, in their order."""
    causes = np.zeros((len(_OF_PATHS), DERIVATIVES))
    motion = motion_by_parameters(traced.parameters[:POSE_SIZE], scene.camera, scene.anchors)
    causes[:POSE_SIZE, :MOTION_SIZE] = motion.T
    causes[POSE_SIZE:, MOTION_SIZE:] = np.eye(DERIVATIVES - MOTION_SIZE)
    causes[Unknown.CHAMFER_DEVIATIONS] *= _chamfer(scene.nail, traced.parameters)[1]
    for values in (causes[free[: len(_OF_PATHS)]] @ traced.by_cause.T).astype(np.float32):
        yield _on_rectangle(scene.window, values, 0.0)


def _display_derivative(unknown: Unknown, scene: NailScene, traced: Paths, before: _Stages) -> NDArray[np.float32]:
    """Derivative of the visible share by one of the display's parameters: a difference, from where it first acts."""
    moved = traced.parameters.copy()
    moved[unknown] += _STEP
    display = _display(scene, moved)
    bent = before.bent
    if unknown in _OF_BLUR:
        bent = display.bent(display.blurred(traced.passed))
    elif unknown in _OF_CURVE:
        bent = display.bent(before.blurred)
    return np.asarray((display.sharpened(bent) - before.sharpened) / _STEP, dtype=np.float32)


def _nail_shape(scene: NailScene, parameters: NDArray[np.float64]) -> NailShape:
    nail = scene.nail
    rotation, translation_mm = rotation_and_translation(parameters[:POSE_SIZE], scene.camera, scene.anchors)
    excess = parameters[Unknown.HOLE_RADIUS_EXCESS_MM]
    radius_mm = float(nail.radius_mm + parameters[Unknown.NAIL_RADIUS_EXCESS_MM])
    return NailShape(
        np.ascontiguousarray(rotation),
        np.ascontiguousarray(translation_mm),
        radius_mm,
        0.5 * nail.cannulation_diameter_mm,
        np.array([_bore_row(h, excess, radius_mm - _chamfer(nail, parameters)[0]) for h in nail.holes]),
        ATTENUATION_PER_MM[nail.material] * float(np.exp(parameters[Unknown.LOG_ATTENUATION])),
        float(parameters[Unknown.POWER]),
    )


def _chamfer(nail: NailPart, parameters: NDArray[np.float64]) -> tuple[float, float]:
    """Depth of the holes' chamfers in mm, and its change by the unknown, which ends where there is no chamfer left."""
    stated = [hole.chamfer_mm for hole in nail.holes if hole.chamfer_mm is not None]
    mean, deviation = USUAL_CHAMFER_MM, USUAL_CHAMFER_SD_MM
    if len(stated) == len(nail.holes):
        mean, deviation = float(np.mean(stated)), STATED_CHAMFER_SD_MM
    depth_mm = mean + deviation * float(parameters[Unknown.CHAMFER_DEVIATIONS])
    return (depth_mm, deviation) if depth_mm > 0.0 else (0.0, 0.0)


def _bore_row(hole: Hole, excess_mm: float, widening_mm: float) -> tuple[float, ...]:
    return (*hole.axis.point_mm, *hole.axis.direction, 0.5 * hole.diameter_mm + excess_mm, widening_mm)


def _on_rectangle(window: Window, values: NDArray[Real], elsewhere: float) -> NDArray[Real]:
    """Values of the support's pixels, shape (S,), on the whole rectangle, shape of it."""
    out = np.full(window.shape, elsewhere, dtype=values.dtype)
    out.ravel()[window.support] = values
    return out
