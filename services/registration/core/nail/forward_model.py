"""The forward model: how much of the background each pixel sees past guide, nail and balls.

The grey value of a pixel is  background * visible + floor * (1 - visible). `visible` follows from what lies on the
ray, metal (`attenuation.py`) and the guide's body, exp(-mu * path): blurred, bent by the display's curve, sharpened by
edge enhancement (`imaging_chain.py`).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.pose_estimate import POSE_SIZE
from services.registration.core.nail.attenuation import DERIVATIVES, MOTION_SIZE, NailShape, trace_pixels
from services.registration.core.nail.imaging_chain import (
    CHAIN_PARAMETERS,
    SHARPENING_PARAMETERS,
    ImagingChain,
    Real,
    Scale,
    derivative_before_sharpening,
    derivative_of_sharpening,
    imaging_chain_of,
)
from services.registration.core.nail.noise import (
    WhiteningFilter,
)
from services.registration.core.nail.occluders import Occluders
from services.registration.core.nail.parameters import (
    ATTENUATION_PER_MM,
    STATED_CHAMFER_SD_MM,
    STEEL_IN_NAIL_MATERIAL,
    USUAL_CHAMFER_MM,
    USUAL_CHAMFER_SD_MM,
    Anchors,
    Parameter,
    anchors_of,
    motion_by_parameters,
    pose_from_parameters,
    rotation_and_translation,
)
from services.registration.core.nail.rays import LEAST_RAYS_TO_SHARE, SAMPLES_PX, rays_of
from services.registration.core.nail.region import FitRegion, cut_region
from shared.geometry.calibration import CArmCalibration
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import Hole, NailPart
from shared.geometry.transform import Transform
from shared.two_cores import mapped, on_both_halves

# Unknowns in the order of the kernel's derivatives.
_PATH_PARAMETERS = tuple(Parameter)[: Parameter.HARDENING + 1]

# Pictures with fewer pixels in all are done sooner than handed to another core.
_LEAST_PX = 100_000


@dataclass(frozen=True, slots=True, eq=False)
class ForwardModel:
    """All that is fixed during a fit: the window, the camera and the nail's nominal shape.

    Attributes
    ----------
    whitening
        Filter that image and model both go through.
    """

    region: FitRegion
    camera: PinholeCamera
    anchors: Anchors
    nail: NailPart
    whitening: WhiteningFilter | None

    def compared(self, picture: NDArray[Real]) -> NDArray[np.float64]:
        """The strip's pixels, shape (N,), of a picture of the window, whitened when the scene says so."""
        if self.whitening is None:
            return self.region.strip(picture)
        return self.region.strip(self.whitening.apply(picture))

    @property
    def grey(self) -> NDArray[np.float64]:
        """Measured grey values that the model is compared with, shape (N,)."""
        return self.compared(self.region.grey)

    def pose(self, parameters: NDArray[np.float64]) -> Transform[Camera, Nail]:
        """`camera_from_nail` that the parameters stand for."""
        return pose_from_parameters(parameters[:POSE_SIZE], self.camera, self.anchors)


def nail_scene(region: FitRegion, camera: PinholeCamera, anchors: Anchors, nail: NailPart) -> ForwardModel:
    """Scene as it is before anything has been learned from a fit."""
    return ForwardModel(region, camera, anchors, nail, None)


@dataclass(frozen=True, slots=True, eq=False)
class FitInput:
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


def model_at(given: FitInput, camera_from_nail: Transform[Camera, Nail], detail: Detail) -> ForwardModel | None:
    """The model around a pose; `None` when the nail's holes are not in the image."""
    region = cut_region(
        given.pixels,
        given.calibration,
        given.nail,
        detail.surroundings_mm,
        camera_from_nail,
        given.occluders,
        detail.scale,
    )
    if region is None:
        return None
    anchors = anchors_of(given.nail)
    return nail_scene(region, given.calibration.camera, anchors, given.nail)


@dataclass(frozen=True, slots=True, eq=False)
class TracedTransmission:
    """What the rays meet: share that passes, on the whole rectangle, and its derivatives on the support.

    Attributes
    ----------
    parameters
        For which the rays were traced.
    transmission
        Share of the X-rays that pass the metal, mean over each pixel, shape (rows, columns).
    derivatives
        Its derivatives by the causes of `attenuation.py`, shape (S, DERIVATIVES).
    """

    parameters: NDArray[np.float64]
    transmission: NDArray[np.float64]
    derivatives: NDArray[np.float32]


def paths(model: ForwardModel, parameters: NDArray[np.float64]) -> TracedTransmission:
    """Trace all rays of the window."""
    region, count = model.region, len(model.region.support)
    transmission, derivatives = np.empty(count), np.empty((count, DERIVATIVES), dtype=np.float32)
    shape = _nail_shape(model, parameters)

    def trace_part(part: slice) -> None:
        rays, steel = rays_of(region.rays, part), region.steel.of(part)
        trace_pixels(rays, SAMPLES_PX, steel, shape, transmission[part], derivatives[part])

    on_both_halves(trace_part, count, LEAST_RAYS_TO_SHARE)
    return TracedTransmission(parameters, _on_rectangle(region, transmission, 1.0), derivatives)


def transmission_derivatives(
    model: ForwardModel, traced: TracedTransmission, free: NDArray[np.bool_]
) -> Iterator[NDArray[np.float32]]:
    """Derivatives of the transmission map by the free parameters that act on the paths, in their order."""
    causes = np.zeros((len(_PATH_PARAMETERS), DERIVATIVES))
    motion = motion_by_parameters(traced.parameters[:POSE_SIZE], model.camera, model.anchors)
    causes[:POSE_SIZE, :MOTION_SIZE] = motion.T
    causes[POSE_SIZE:, MOTION_SIZE:] = np.eye(DERIVATIVES - MOTION_SIZE)
    causes[Parameter.CHAMFER_DEVIATIONS] *= _chamfer(model.nail, traced.parameters)[1]
    for values in causes[free[: len(_PATH_PARAMETERS)]].astype(np.float32) @ traced.derivatives.T:
        yield _on_rectangle(model.region, values, 0.0)


def _nail_shape(model: ForwardModel, parameters: NDArray[np.float64]) -> NailShape:
    nail = model.nail
    rotation, translation_mm = rotation_and_translation(parameters[:POSE_SIZE], model.camera, model.anchors)
    excess = parameters[Parameter.HOLE_RADIUS_EXCESS_MM]
    radius_mm = float(nail.radius_mm + parameters[Parameter.NAIL_RADIUS_EXCESS_MM])
    return NailShape(
        np.ascontiguousarray(rotation),
        np.ascontiguousarray(translation_mm),
        radius_mm,
        0.5 * nail.cannulation_diameter_mm,
        np.array([_bore_row(h, excess, radius_mm - _chamfer(nail, parameters)[0]) for h in nail.holes]),
        ATTENUATION_PER_MM[nail.material] * float(np.exp(parameters[Parameter.LOG_ATTENUATION])),
        float(parameters[Parameter.HARDENING]),
        STEEL_IN_NAIL_MATERIAL[nail.material],
    )


def _chamfer(nail: NailPart, parameters: NDArray[np.float64]) -> tuple[float, float]:
    """Depth of the holes' chamfers in mm, and its change by the unknown, which ends where there is no chamfer left."""
    stated = [hole.chamfer_mm for hole in nail.holes if hole.chamfer_mm is not None]
    mean, deviation = USUAL_CHAMFER_MM, USUAL_CHAMFER_SD_MM
    if len(stated) == len(nail.holes):
        mean, deviation = float(np.mean(stated)), STATED_CHAMFER_SD_MM
    depth_mm = mean + deviation * float(parameters[Parameter.CHAMFER_DEVIATIONS])
    return (depth_mm, deviation) if depth_mm > 0.0 else (0.0, 0.0)


def _bore_row(hole: Hole, excess_mm: float, widening_mm: float) -> tuple[float, ...]:
    return (*hole.axis.point_mm, *hole.axis.direction, 0.5 * hole.diameter_mm + excess_mm, widening_mm)


def has_chamfer(model: ForwardModel, parameters: NDArray[np.float64]) -> bool:
    """Whether the holes still have a chamfer: without one, nothing changes by its unknown."""
    return _chamfer(model.nail, parameters)[0] > 0.0


def _on_rectangle(region: FitRegion, values: NDArray[Real], elsewhere: float) -> NDArray[Real]:
    """Values of the support's pixels, shape (S,), on the whole rectangle, shape of it."""
    out = np.full(region.shape, elsewhere, dtype=values.dtype)
    out.ravel()[region.support] = values
    return out


def visible_fraction(model: ForwardModel, traced: TracedTransmission) -> NDArray[np.float64]:
    """Share of the background that each compared pixel sees, shape (N,); from single precision, which is plenty."""
    transmission = (traced.transmission * _guide_transmission(model, traced.parameters)).astype(np.float32)
    return model.compared(imaging_chain_of(model.region.scale, traced.parameters).apply(transmission))


def visible_fraction_without_metal(model: ForwardModel, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same if nothing but the guide's body were there, shape (N,)."""
    guide = _guide_transmission(model, parameters).astype(np.float32)
    return model.compared(imaging_chain_of(model.region.scale, parameters).apply(guide))


def visible_fraction_derivatives(
    model: ForwardModel, traced: TracedTransmission, free: NDArray[np.bool_]
) -> list[NDArray[np.float64]]:
    """Derivatives of `visible_fraction` by the free parameters, in their order."""
    display = imaging_chain_of(model.region.scale, traced.parameters)
    guide = _guide_transmission(model, traced.parameters)
    transmission = traced.transmission * guide
    stages = display.stages(transmission)
    slope = display.slope(stages).astype(np.float32)
    thin = guide.astype(np.float32)
    least = 2 + _LEAST_PX // transmission.size

    once_sharpened = _compared_once_sharpened(model, display)

    def by_passed(change: NDArray[np.float32]) -> NDArray[np.float64]:
        return once_sharpened(slope * display.blurred(change))

    def by_display(unknown: Parameter) -> NDArray[np.float64]:
        of_display = unknown, model.region.scale, traced.parameters
        if unknown in SHARPENING_PARAMETERS:
            return model.compared(derivative_of_sharpening(*of_display, display, stages))
        return once_sharpened(derivative_before_sharpening(*of_display, transmission, display, stages))

    columns = mapped(lambda p: by_passed(p * thin), transmission_derivatives(model, traced, free), least)
    columns += mapped(by_display, [unknown for unknown in CHAIN_PARAMETERS if free[unknown]], least)
    if free[Parameter.DELRIN_PER_MM]:
        columns.append(by_passed((-model.region.delrin_excess_mm * transmission).astype(np.float32)))
    return columns


def _compared_once_sharpened(
    model: ForwardModel, display: ImagingChain
) -> Callable[[NDArray[np.float32]], NDArray[np.float64]]:
    """What `ForwardModel.compared` makes of a picture after edge enhancement; the scene's filter takes both in one."""
    if model.whitening is None:
        return lambda picture: model.compared(display.sharpened(picture))
    both = model.whitening.after(display.sharpened)
    return lambda picture: model.region.strip(both.apply(picture))


def _guide_transmission(model: ForwardModel, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share of the X-rays that pass the guide's body, over the usual one (1 in most places), shape (rows, columns)."""
    return np.asarray(np.exp(-parameters[Parameter.DELRIN_PER_MM] * model.region.delrin_excess_mm))
