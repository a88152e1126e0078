"""The forward model: how much of the background each pixel sees past guide, nail and balls.

The grey value of a pixel is  background * visible + floor * (1 - visible). `visible` follows from what lies on the
ray, metal (`attenuation.py`) and the guide's body, exp(-mu * path): blurred, bent by the display's curve, sharpened by
edge enhancement (`imaging_chain.py`).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.attenuation import DERIVATIVES, MOTION_SIZE, NailShape, trace
from services.registration.core.nail.imaging_chain import (
    OF_DISPLAY,
    OF_SHARPENING,
    Display,
    Real,
    Scale,
    derivative_before_sharpening,
    derivative_of_sharpening,
    display_of,
)
from services.registration.core.nail.noise import (
    Whitening,
)
from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.parameters import (
    ATTENUATION_PER_MM,
    POSE_SIZE,
    STATED_CHAMFER_SD_MM,
    STEEL_IN_NAIL_MATERIAL,
    USUAL_CHAMFER_MM,
    USUAL_CHAMFER_SD_MM,
    Anchors,
    Unknown,
    anchors_of,
    motion_by_parameters,
    pose_from_parameters,
    rotation_and_translation,
)
from services.registration.core.nail.rays import LEAST_RAYS_TO_SHARE, SAMPLES_PX, rays_of
from services.registration.core.nail.region import Window, cut_window
from shared.geometry.calibration import CArmCalibration
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import Hole, NailPart
from shared.geometry.transform import Transform
from shared.two_cores import mapped, on_both_halves

# Unknowns in the order of the kernel's derivatives.
_OF_PATHS = tuple(Unknown)[: Unknown.HARDENING + 1]

# Pictures with fewer pixels in all are done sooner than handed to another core.
_LEAST_PX = 100_000


@dataclass(frozen=True, slots=True, eq=False)
class NailScene:
    """All that is fixed during a fit: the window, the camera and the nail's nominal shape.

    Attributes
    ----------
    whitening
        Filter that image and model both go through.
    """

    window: Window
    camera: PinholeCamera
    anchors: Anchors
    nail: NailPart
    whitening: Whitening | None

    def compared(self, picture: NDArray[Real]) -> NDArray[np.float64]:
        """The strip's pixels, shape (N,), of a picture of the window, whitened when the scene says so."""
        if self.whitening is None:
            return self.window.strip(picture)
        return self.window.strip(self.whitening.apply(picture))

    @property
    def grey(self) -> NDArray[np.float64]:
        """Measured grey values that the model is compared with, shape (N,)."""
        return self.compared(self.window.grey)

    def pose(self, parameters: NDArray[np.float64]) -> Transform[Camera, Nail]:
        """`camera_from_nail` that the parameters stand for."""
        return pose_from_parameters(parameters[:POSE_SIZE], self.camera, self.anchors)


def nail_scene(window: Window, camera: PinholeCamera, anchors: Anchors, nail: NailPart) -> NailScene:
    """Scene as it is before anything has been learned from a fit."""
    return NailScene(window, camera, anchors, nail, None)


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
        Its derivatives by the causes of `attenuation.py`, shape (S, DERIVATIVES).
    """

    parameters: NDArray[np.float64]
    passed: NDArray[np.float64]
    by_cause: NDArray[np.float32]


def paths(scene: NailScene, parameters: NDArray[np.float64]) -> Paths:
    """Trace all rays of the window."""
    window, count = scene.window, len(scene.window.support)
    passed, by_cause = np.empty(count), np.empty((count, DERIVATIVES), dtype=np.float32)
    shape = _nail_shape(scene, parameters)

    def trace_part(part: slice) -> None:
        rays, steel = rays_of(window.rays, part), window.steel.of(part)
        trace(rays, SAMPLES_PX, steel, shape, passed[part], by_cause[part])

    on_both_halves(trace_part, count, LEAST_RAYS_TO_SHARE)
    return Paths(parameters, _on_rectangle(window, passed, 1.0), by_cause)


def derivatives_of_paths(scene: NailScene, traced: Paths, free: NDArray[np.bool_]) -> Iterator[NDArray[np.float32]]:
    """Derivatives of the transmission map by the free parameters that act on the paths, in their order."""
    causes = np.zeros((len(_OF_PATHS), DERIVATIVES))
    motion = motion_by_parameters(traced.parameters[:POSE_SIZE], scene.camera, scene.anchors)
    causes[:POSE_SIZE, :MOTION_SIZE] = motion.T
    causes[POSE_SIZE:, MOTION_SIZE:] = np.eye(DERIVATIVES - MOTION_SIZE)
    causes[Unknown.CHAMFER_DEVIATIONS] *= _chamfer(scene.nail, traced.parameters)[1]
    for values in causes[free[: len(_OF_PATHS)]].astype(np.float32) @ traced.by_cause.T:
        yield _on_rectangle(scene.window, values, 0.0)


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
        float(parameters[Unknown.HARDENING]),
        STEEL_IN_NAIL_MATERIAL[nail.material],
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


def chamfer_is_left(scene: NailScene, parameters: NDArray[np.float64]) -> bool:
    """Whether the holes still have a chamfer: without one, nothing changes by its unknown."""
    return _chamfer(scene.nail, parameters)[0] > 0.0


def _on_rectangle(window: Window, values: NDArray[Real], elsewhere: float) -> NDArray[Real]:
    """Values of the support's pixels, shape (S,), on the whole rectangle, shape of it."""
    out = np.full(window.shape, elsewhere, dtype=values.dtype)
    out.ravel()[window.support] = values
    return out


def visible_share(scene: NailScene, traced: Paths) -> NDArray[np.float64]:
    """Share of the background that each compared pixel sees, shape (N,); from single precision, which is plenty."""
    passed = (traced.passed * _guide_share(scene, traced.parameters)).astype(np.float32)
    return scene.compared(display_of(scene.window.scale, traced.parameters).shown(passed))


def share_without_metal(scene: NailScene, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same if nothing but the guide's body were there, shape (N,)."""
    guide = _guide_share(scene, parameters).astype(np.float32)
    return scene.compared(display_of(scene.window.scale, parameters).shown(guide))


def derivatives_of_share(scene: NailScene, traced: Paths, free: NDArray[np.bool_]) -> list[NDArray[np.float64]]:
    """Derivatives of `visible_share` by the free parameters, in their order."""
    display, guide = display_of(scene.window.scale, traced.parameters), _guide_share(scene, traced.parameters)
    passed = traced.passed * guide
    stages = display.stages(passed)
    slope = display.slope(stages).astype(np.float32)
    thin = guide.astype(np.float32)
    least = 2 + _LEAST_PX // passed.size

    once_sharpened = _compared_once_sharpened(scene, display)

    def by_passed(change: NDArray[np.float32]) -> NDArray[np.float64]:
        return once_sharpened(slope * display.blurred(change))

    def by_display(unknown: Unknown) -> NDArray[np.float64]:
        of_display = unknown, scene.window.scale, traced.parameters
        if unknown in OF_SHARPENING:
            return scene.compared(derivative_of_sharpening(*of_display, display, stages))
        return once_sharpened(derivative_before_sharpening(*of_display, passed, display, stages))

    columns = mapped(lambda p: by_passed(p * thin), derivatives_of_paths(scene, traced, free), least)
    columns += mapped(by_display, [unknown for unknown in OF_DISPLAY if free[unknown]], least)
    if free[Unknown.DELRIN_PER_MM]:
        columns.append(by_passed((-scene.window.delrin_excess_mm * passed).astype(np.float32)))
    return columns


def _compared_once_sharpened(
    scene: NailScene, display: Display
) -> Callable[[NDArray[np.float32]], NDArray[np.float64]]:
    """What `NailScene.compared` makes of a picture after edge enhancement; the scene's filter takes both in one."""
    if scene.whitening is None:
        return lambda picture: scene.compared(display.sharpened(picture))
    both = scene.whitening.after(display.sharpened)
    return lambda picture: scene.window.strip(both.apply(picture))


def _guide_share(scene: NailScene, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of the X-rays that pass the guide's body, over the usual one (1 in most places), shape (rows, columns)."""
    return np.asarray(np.exp(-parameters[Unknown.DELRIN_PER_MM] * scene.window.delrin_excess_mm))
