"""Which share of the X-rays passes the metal in each pixel of the window, and how that changes with the unknowns."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.blur import Real
from services.registration.core.nail.pixel_rays import LEAST_RAYS_TO_SHARE, SAMPLES_PX, rays_of
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
from shared.two_cores import on_both_halves

# Unknowns in the order of the kernel's derivatives.
_OF_PATHS = tuple(Unknown)[: Unknown.HARDENING + 1]


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
