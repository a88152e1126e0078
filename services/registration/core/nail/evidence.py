"""Evidence for and against a fitted nail: how much of each hole was seen, and what stays unexplained."""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.image import HoleView, ResidualStatistics
from services.registration.core.nail.forward_model import ForwardModel, visible_fraction_without_metal
from services.registration.core.nail.imaging_chain import blurred_image
from services.registration.core.nail.least_squares import LinearSolution, NoiseModel, Problem, Solution
from services.registration.core.nail.noise import MEDIAN_TO_DEVIATION
from services.registration.core.nail.region import FitRegion
from shared.geometry.parts import Hole

_OPEN = 0.5
_CERTAIN, _LEAST_STEP = 8.0, 0.3
_STRUCTURE_BLUR_PX, _SPOT_BLUR_PX = 2.0, 1.0
_ABOUT_HOLE_MM = 1.0
_RIM = (0.03, 0.97)


def hole_views(problem: Problem, solution: Solution) -> tuple[HoleView, ...]:
    """Opening and contrast of each hole of the nail."""
    model = problem.model
    region = model.region
    parameters = solution.parameters
    clear = solution.linear.traced.transmission.ravel()[region.compared] > _OPEN
    noise = float(np.sqrt(np.median(1.0 / problem.weight)))
    contrast = _local_step(model, solution.linear) / noise
    return tuple(_hole_view(problem, parameters, hole, clear, contrast) for hole in model.nail.holes)


def _hole_view(
    problem: Problem,
    parameters: NDArray[np.float64],
    hole: Hole,
    clear: NDArray[np.bool_],
    contrast: NDArray[np.float64],
) -> HoleView:
    model = problem.model
    region = model.region
    radius = 0.5 * hole.diameter_mm
    centre_x, centre_y = hole.axis.point_mm[:2]
    near = np.hypot(region.along_mm - centre_x, region.across_mm - centre_y) < 1.5 * radius
    inside_nail = np.abs(region.across_mm) < 0.8 * model.nail.radius_mm
    seen = clear & near & inside_nail
    depth = float(model.pose(parameters).translation_mm[2])
    pixel_mm = depth / model.camera.focal_length_px * region.scale.reduction
    opening = float(np.count_nonzero(seen)) * pixel_mm**2 / (np.pi * radius**2)
    to_noise = float(np.median(contrast[seen])) if np.any(seen) else 0.0
    return HoleView(hole.id, min(opening, 1.0), to_noise)


def residual_statistics(problem: Problem, solution: Solution, noise: NoiseModel) -> ResidualStatistics:
    """Size and structure of the residual."""
    region, residual = problem.model.region, solution.linear.residual
    standardised = np.zeros(region.shape)
    standardised.ravel()[region.compared] = np.clip(residual * np.sqrt(problem.weight), -6.0, 6.0)
    smooth = blurred_image(standardised, _STRUCTURE_BLUR_PX).ravel()[region.compared]
    visible = solution.linear.visible
    rim = (visible > _RIM[0]) & (visible < _RIM[1])
    elsewhere = ~rim
    rms = float(np.sqrt(np.mean(residual**2))) * region.grey_scale
    reference = float(np.sqrt(np.mean(smooth[elsewhere] ** 2))) if np.any(elsewhere) else 1.0
    at_rims = float(np.sqrt(np.mean(smooth[rim] ** 2))) if np.any(rim) else 0.0
    inflation = float(noise.inflation.mean())
    return ResidualStatistics(rms, at_rims / max(reference, 1e-9), inflation, _spot(problem, solution.linear, noise))


def _spot(problem: Problem, linear: LinearSolution, noise: NoiseModel) -> float:
    region = problem.model.region
    near = np.zeros(len(region.compared), dtype=bool)
    for hole in problem.model.nail.holes:
        x, y = hole.axis.point_mm[:2]
        near |= np.hypot(region.along_mm - x, region.across_mm - y) < 0.5 * hole.diameter_mm + _ABOUT_HOLE_MM
    step = np.abs(_local_step(problem.model, linear))
    deviations = np.abs(_smoothed(region, linear.residual / np.sqrt(noise.variance)))
    certain = deviations > _CERTAIN * MEDIAN_TO_DEVIATION * np.median(deviations)
    share = np.abs(_smoothed(region, linear.residual)) / np.maximum(step, _LEAST_STEP * np.median(step))
    return float(share[near & certain].max(initial=0.0))


def _local_step(model: ForwardModel, linear: LinearSolution) -> NDArray[np.float64]:
    """From the grey value behind metal to the one that no metal hides, under the guide's body, shape (N,)."""
    return visible_fraction_without_metal(model, linear.traced.parameters) * (linear.background - linear.floor)


def _smoothed(region: FitRegion, values: NDArray[np.float64]) -> NDArray[np.float64]:
    image = np.zeros(region.shape)
    image.ravel()[region.compared] = values
    return blurred_image(image, _SPOT_BLUR_PX).ravel()[region.compared]
