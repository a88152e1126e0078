"""The forward model: which fraction of the background each pixel shows past guide, nail and balls.

The grey value of a pixel is  background * visible + floor * (1 - visible). The visible fraction follows from what lies
on the ray, metal (`attenuation.py`) and the guide's body, exp(-mu * path): blurred, bent by the display's curve,
sharpened by edge enhancement (`imaging_chain.py`).
"""

from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.pose_estimate import POSE_SIZE
from services.registration.core.nail.attenuation import DERIVATIVES, MOTION_SIZE, TraceLimits, trace_pixels
from services.registration.core.nail.imaging_chain import (
    Real,
    Sampling,
    imaging_chain,
)
from services.registration.core.nail.noise import WhiteningFilter
from services.registration.core.nail.parameters import (
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
    TILT_SEARCH_STAGE,
    CentringStage,
    ComparisonStage,
    FinalStage,
    NailTracking,
    TiltSearchStage,
)
from shared.geometry.bend import section_frame
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import Hole, NailPart
from shared.geometry.transform import Transform
from shared.two_cores import on_both_halves
from shared.xray.pixel_scale import quantised_pitch_mm

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


def reduced_model(
    fit_input: FitInput, camera_from_nail: Transform[Camera, Nail], stage: StageSettings, hole_width_px: float
) -> ForwardModel | None:
    """The same, reduced until the smallest hole is about so many pixels wide, and at least as the tilt search is."""
    px_per_mm = fit_input.calibration.camera.focal_length_px / float(camera_from_nail.translation_mm[2])
    smallest_mm = min(hole.diameter_mm for hole in fit_input.nail.holes)
    reduction = max(TILT_SEARCH_STAGE.least_reduction, round(smallest_mm * px_per_mm / hole_width_px))
    return model_at(fit_input, camera_from_nail, stage, reduction)


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
    """Trace all rays of the region."""
    return trace_metal(model, parameters, nail_shape(model, parameters))


def trace_metal(model: ForwardModel, parameters: NDArray[np.float64], shape: NailShape) -> TracedTransmission:
    """The same for a shape of the nail; of a bent one, section by section."""
    region, count, curvature = model.region, len(model.region.support), curvature_of(parameters)
    limits = TraceLimits(*astuple(RAY_SAMPLING))
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


def nail_shape(model: ForwardModel, parameters: NDArray[np.float64]) -> NailShape:
    """The nail with the fit's parameters."""
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
    transmission = (traced.transmission * guide_transmission(model, traced.parameters)).astype(np.float32)
    return model.compared_values(imaging_chain(model.region.sampling, traced.parameters).apply(transmission))


def visible_image(model: ForwardModel, traced: TracedTransmission) -> NDArray[np.float64]:
    """Fraction of the background on the whole rectangle, not whitened."""
    transmission = traced.transmission * guide_transmission(model, traced.parameters)
    return imaging_chain(model.region.sampling, traced.parameters).apply(transmission)


def visible_fraction_without_metal(model: ForwardModel, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same if nothing but the guide's body were there, shape (N,)."""
    guide = guide_transmission(model, parameters).astype(np.float32)
    return model.compared_values(imaging_chain(model.region.sampling, parameters).apply(guide))


def guide_transmission(model: ForwardModel, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """Transmission of the guide's body over the usual one (1 in most places), shape (rows, columns)."""
    return np.asarray(np.exp(-parameters[Parameter.DELRIN_PER_MM] * model.region.delrin_excess_mm))
