"""The forward model: which fraction of the background each pixel shows past guide, nail and balls.

The grey value of a pixel is  background * visible + floor * (1 - visible). The visible fraction follows from what lies
on the ray, metal (`attenuation.py`) and the guide's body, exp(-mu * path): blurred, bent by the display's curve,
sharpened by edge enhancement (`imaging_chain.py`).
"""

from collections.abc import Callable, Iterator
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.pose_estimate import POSE_SIZE
from services.registration.core.nail.attenuation import DERIVATIVES, MOTION_SIZE, TraceLimits, trace_pixels
from services.registration.core.nail.imaging_chain import (
    CHAIN_PARAMETERS,
    SHARPENING_PARAMETERS,
    ImagingChain,
    Real,
    Sampling,
    chain_derivative,
    imaging_chain,
)
from services.registration.core.nail.noise import WhiteningFilter
from services.registration.core.nail.parameters import (
    CURVATURE,
    Anchors,
    Parameter,
    anchors_of,
    chamfer,
    curvature_of,
    motion_by_parameters,
    parameters_from_pose,
    pose_from_parameters,
    rotation_and_translation,
)
from services.registration.core.nail.rays import (
    LEAST_RAYS_TO_SHARE,
    SAMPLES_PX,
    NailShape,
    PixelRays,
    SteelPaths,
    rays_of,
    section_places,
    section_shape,
    sections_of,
)
from services.registration.core.nail.region import FitInput, FitRegion, cut_region
from services.registration.core.tuning import (
    BEAM,
    RAY_SAMPLING,
    CentringStage,
    ComparisonStage,
    FinalStage,
    NailTracking,
    TiltSearchStage,
)
from shared.geometry.bend import section_frame, section_motions
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import Hole, NailPart
from shared.geometry.transform import Transform
from shared.two_cores import mapped, on_both_halves
from shared.xray.pixel_scale import quantised_pitch_mm

# Parameters in the order of the kernel's derivatives.
_PATH_PARAMETERS = tuple(Parameter)[: Parameter.HARDENING + 1]
# Images with fewer pixels in all are done sooner than handed to another core.
_LEAST_PIXELS_TO_SHARE = 100_000
# What a stage of the fit compares.
StageSettings = CentringStage | TiltSearchStage | ComparisonStage | FinalStage | NailTracking


@dataclass(frozen=True, slots=True, eq=False)
class ForwardModel:
    """What is fixed during a fit: the region, the camera and the nail's nominal shape."""

    region: FitRegion
    camera: PinholeCamera
    anchors: Anchors
    nail: NailPart
    # Filter through which image and model pass before they are compared, if any
    whitening: WhiteningFilter | None = None

    def compared_values(self, image: NDArray[Real]) -> NDArray[np.float64]:
        """The compared pixels, shape (N,), of an image of the region, whitened if the model whitens."""
        if self.whitening is None:
            return self.region.compared_values(image)
        return self.region.compared_values(self.whitening.apply(image))

    @property
    def observed(self) -> NDArray[np.float64]:
        """Measured grey values with which the model is compared, shape (N,)."""
        return self.compared_values(self.region.grey)

    def pose(self, parameters: NDArray[np.float64]) -> Transform[Camera, Nail]:
        """`camera_from_nail` of the parameters."""
        return pose_from_parameters(parameters[:POSE_SIZE], self.camera, self.anchors)

    def motion_by_parameters(self, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        """Small motion of the nail by the pose's parameters (see there), shape (6, 6)."""
        return motion_by_parameters(parameters[:POSE_SIZE], self.camera, self.anchors)

    def with_pose(
        self, parameters: NDArray[np.float64], camera_from_nail: Transform[Camera, Nail]
    ) -> NDArray[np.float64]:
        """The parameters, shape (PARAMETER_COUNT,), with those of a pose in place of their own."""
        moved = parameters.copy()
        moved[:POSE_SIZE] = parameters_from_pose(camera_from_nail, self.camera, self.anchors)
        return moved


def model_at(
    fit_input: FitInput, camera_from_nail: Transform[Camera, Nail], stage: StageSettings, reduction: int
) -> ForwardModel | None:
    """The model around a pose, in pixels of so many image pixels; `None` when the holes are not in the image."""
    calibration, nail = fit_input.calibration, fit_input.nail
    sampling = Sampling(reduction, stage.smoothing_px, quantised_pitch_mm(calibration.pixel_mm))
    region = cut_region(fit_input, camera_from_nail, stage.surroundings_mm, sampling)
    return None if region is None else ForwardModel(region, calibration.camera, anchors_of(nail), nail)


@dataclass(frozen=True, slots=True, eq=False)
class TracedTransmission:
    """Transmission of the metal in all pixels, and its derivatives."""

    parameters: NDArray[np.float64]  # for which the rays were traced
    # Of the metal, mean over each pixel of the whole rectangle, shape (rows, columns)
    transmission: NDArray[np.float64]
    # By the nail's motion, radii and material (`attenuation.py`), of the support's pixels, shape (S, DERIVATIVES)
    derivatives: NDArray[np.float32]
    # Arc length along the nail in whose cross-section each of the support's rays was traced, shape (S,); None when the
    # nail is straight
    along_mm: NDArray[np.float64] | None = None


def trace_transmission(model: ForwardModel, parameters: NDArray[np.float64]) -> TracedTransmission:
    """Trace all rays of the region; of a bent nail, section by section."""
    region, count, curvature = model.region, len(model.region.support), curvature_of(parameters)
    shape, limits = _nail_shape(model, parameters), TraceLimits(*astuple(RAY_SAMPLING))
    transmission, derivatives = np.empty(count), np.empty((count, DERIVATIVES), dtype=np.float32)

    def trace(rays: PixelRays, steel: SteelPaths, nail: NailShape, part: slice) -> None:
        rays, steel = rays_of(rays, part), steel.of(part)
        trace_pixels(rays, SAMPLES_PX, steel, nail, limits, transmission[part], derivatives[part])

    if curvature == (0.0, 0.0):
        on_both_halves(lambda part: trace(region.rays, region.steel, shape, part), count, LEAST_RAYS_TO_SHARE)
        return TracedTransmission(parameters, region.on_rectangle(transmission, 1.0), derivatives)
    along_mm = section_places(model.nail, curvature, region.rays, shape)
    order = np.argsort(along_mm, kind="stable")
    rays, steel = rays_of(region.rays, order), region.steel.of(order)

    def trace_sections(part: slice) -> None:
        for section in sections_of(along_mm[order], part):
            x_mm, own = float(along_mm[order[section.start]]), derivatives[section]
            frame = section_frame(curvature, x_mm)
            trace(rays, steel, section_shape(shape, frame, x_mm), section)
            own[:, :MOTION_SIZE] = own[:, :MOTION_SIZE] @ frame.inverse().adjoint.astype(np.float32)

    on_both_halves(trace_sections, count, LEAST_RAYS_TO_SHARE)
    back = np.argsort(order)
    return TracedTransmission(parameters, region.on_rectangle(transmission[back], 1.0), derivatives[back], along_mm)


def _nail_shape(model: ForwardModel, parameters: NDArray[np.float64]) -> NailShape:
    nail = model.nail
    rotation, translation_mm = rotation_and_translation(parameters[:POSE_SIZE], model.camera, model.anchors)
    excess = parameters[Parameter.HOLE_RADIUS_EXCESS_MM]
    radius_mm = float(nail.radius_mm + parameters[Parameter.NAIL_RADIUS_EXCESS_MM])
    chamfer_mm = chamfer(nail, parameters)[0]
    usual_per_mm = BEAM.steel_attenuation_per_mm if nail.material == "steel" else BEAM.titanium_attenuation_per_mm
    per_mm = usual_per_mm * float(np.exp(parameters[Parameter.LOG_ATTENUATION]))
    return NailShape(
        rotation=np.ascontiguousarray(rotation),
        translation_mm=np.ascontiguousarray(translation_mm),
        radius_mm=radius_mm,
        cannulation_radius_mm=0.5 * nail.cannulation_diameter_mm,
        bores=_bores(nail, excess, radius_mm, chamfer_mm),
        material=(per_mm, float(parameters[Parameter.HARDENING]), BEAM.hardest_share),
        steel_in_nail_material=BEAM.steel_attenuation_per_mm / usual_per_mm,
    )


def _bores(nail: NailPart, excess_mm: float, radius_mm: float, chamfer_mm: float) -> NDArray[np.float64]:
    """`NailShape.bores`; a leaning hole's chamfer begins below where its axis leaves the nail."""

    def row(hole: Hole) -> tuple[float, ...]:
        widening_mm = radius_mm / hole.cosine_across_nail - chamfer_mm
        return *hole.axis.point_mm, *hole.axis.direction, 0.5 * hole.diameter_mm + excess_mm, widening_mm

    rows = np.array([row(hole) for hole in nail.all_holes])
    half_slots_mm = np.array([[hole.half_slot_mm] for hole in nail.all_holes])
    return np.hstack([rows, half_slots_mm])[None] if half_slots_mm.any() else rows


def visible_fraction(model: ForwardModel, traced: TracedTransmission) -> NDArray[np.float64]:
    """Fraction of the background that each compared pixel shows, shape (N,); single precision suffices."""
    transmission = (traced.transmission * _guide_transmission(model, traced.parameters)).astype(np.float32)
    return model.compared_values(imaging_chain(model.region.sampling, traced.parameters).apply(transmission))


def visible_image(model: ForwardModel, traced: TracedTransmission) -> NDArray[np.float64]:
    """Fraction of the background on the whole rectangle, not whitened."""
    transmission = traced.transmission * _guide_transmission(model, traced.parameters)
    return imaging_chain(model.region.sampling, traced.parameters).apply(transmission)


def visible_fraction_without_metal(model: ForwardModel, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same if nothing but the guide's body were there, shape (N,)."""
    guide = _guide_transmission(model, parameters).astype(np.float32)
    return model.compared_values(imaging_chain(model.region.sampling, parameters).apply(guide))


def visible_fraction_derivatives(
    model: ForwardModel, traced: TracedTransmission, free: NDArray[np.bool_]
) -> list[NDArray[np.float64]]:
    """Derivatives of `visible_fraction` by the free parameters, in their order."""
    chain = imaging_chain(model.region.sampling, traced.parameters)
    guide = _guide_transmission(model, traced.parameters)
    transmission = traced.transmission * guide
    images = chain.steps(transmission)
    slope, guide_single = chain.tone_slope(images).astype(np.float32), guide.astype(np.float32)
    least = 2 + _LEAST_PIXELS_TO_SHARE // transmission.size
    sharpened_values = _sharpened_values(model, chain)

    def by_transmission(change: NDArray[np.float32]) -> NDArray[np.float64]:
        return sharpened_values(slope * chain.blurred(change))

    def by_chain(parameter: Parameter) -> NDArray[np.float64]:
        change = chain_derivative(parameter, model.region.sampling, traced.parameters, transmission, images)
        return model.compared_values(change) if parameter in SHARPENING_PARAMETERS else sharpened_values(change)

    by_path = _transmission_derivatives(model, traced, free)
    columns = mapped(lambda change: by_transmission(change * guide_single), by_path, least)
    columns += mapped(by_chain, [parameter for parameter in CHAIN_PARAMETERS if free[parameter]], least)
    if free[Parameter.DELRIN_PER_MM]:
        columns.append(by_transmission((-model.region.delrin_excess_mm * transmission).astype(np.float32)))
    if free[CURVATURE].any():
        by_bend = _derivatives_by_curvature(model, traced)[free[CURVATURE]]
        columns += [by_transmission(model.region.on_rectangle(values, 0.0) * guide_single) for values in by_bend]
    return columns


def _derivatives_by_curvature(model: ForwardModel, traced: TracedTransmission) -> NDArray[np.float32]:
    """Derivatives of the transmission of the support's pixels by the curvature towards y and z (1/m), shape (2, S)."""
    curvature, along_mm = curvature_of(traced.parameters), traced.along_mm
    if along_mm is None:
        along_mm = section_places(model.nail, curvature, model.region.rays, _nail_shape(model, traced.parameters))
    by_motion = traced.derivatives[:, :MOTION_SIZE]
    change, power = np.zeros((len(along_mm), 2)), along_mm.copy()
    for term in section_motions(curvature):
        change += power[:, None] * (by_motion @ term)
        power *= along_mm
    return np.ascontiguousarray(change.T, dtype=np.float32)


def _transmission_derivatives(
    model: ForwardModel, traced: TracedTransmission, free: NDArray[np.bool_]
) -> Iterator[NDArray[np.float32]]:
    """Derivatives of the transmission by the free parameters that act on the paths, in their order."""
    causes = np.zeros((len(_PATH_PARAMETERS), DERIVATIVES))
    causes[:POSE_SIZE, :MOTION_SIZE] = model.motion_by_parameters(traced.parameters).T
    causes[POSE_SIZE:, MOTION_SIZE:] = np.eye(DERIVATIVES - MOTION_SIZE)
    causes[Parameter.CHAMFER_DEVIATIONS] *= chamfer(model.nail, traced.parameters)[1]
    for values in causes[free[: len(_PATH_PARAMETERS)]].astype(np.float32) @ traced.derivatives.T:
        yield model.region.on_rectangle(values, 0.0)


def _sharpened_values(model: ForwardModel, chain: ImagingChain) -> Callable[[NDArray[np.float32]], NDArray[np.float64]]:
    """The compared pixels of an image after edge enhancement; with whitening, both filters are applied as one."""
    if model.whitening is None:
        return lambda image: model.compared_values(chain.sharpened(image))
    both = model.whitening.after(chain.sharpened)
    return lambda image: model.region.compared_values(both.apply(image))


def _guide_transmission(model: ForwardModel, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """Transmission of the guide's body over the usual one (1 in most places), shape (rows, columns)."""
    return np.asarray(np.exp(-parameters[Parameter.DELRIN_PER_MM] * model.region.delrin_excess_mm))
