"""What the acceptance of a fitted nail depends on: how holes are seen, what the model leaves, whether parts agree."""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.image import HoleView, ResidualStatistics
from services.registration.core.nail.agreement import Agreement, PixelScores, agreement
from services.registration.core.nail.covariance import after_background, motion_gain
from services.registration.core.nail.forward_model import visible_fraction_without_metal
from services.registration.core.nail.imaging_chain import blurred_image
from services.registration.core.nail.least_squares import Problem, Solution, linear_response
from services.registration.core.nail.noise import MEDIAN_TO_DEVIATION, NoiseModel
from services.registration.core.nail.region import FitRegion
from services.registration.core.tuning import NAIL_EVIDENCE
from shared.geometry.parts import Hole


def agreement_of_parts(problem: Problem, solution: Solution, noise: NoiseModel) -> Agreement:
    """Whether sectors of rims and stretches of edges pull on the pose as the noise predicts."""
    linear = linear_response(solution.linear, solution.equations.jacobian)
    moved_by = after_background(problem, solution, linear, motion_gain(problem, solution))
    variance = problem.weight**2 * noise.variance * noise.inflation
    pixels = PixelScores(moved_by, problem.weight * solution.linear.residual, variance)
    model = problem.model
    return agreement(model.region, model.nail, pixels, float(noise.inflation.mean()), solution.parameters)


def hole_views(problem: Problem, solution: Solution) -> tuple[HoleView, ...]:
    """Opening and contrast of each hole of the nail."""
    model = problem.model
    region = model.region
    parameters = solution.parameters
    clear = solution.linear.traced.transmission.ravel()[region.compared] > NAIL_EVIDENCE.open_transmission
    noise = float(np.sqrt(np.median(1.0 / problem.weight)))
    contrast = _local_step(problem, solution) / noise
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
    near = np.hypot(region.along_mm - centre_x, region.across_mm - centre_y) < NAIL_EVIDENCE.near_hole_in_radii * radius
    inside_nail = np.abs(region.across_mm) < NAIL_EVIDENCE.inside_nail_in_radii * model.nail.radius_mm
    seen = clear & near & inside_nail
    depth = float(model.pose(parameters).translation_mm[2])
    pixel_mm = depth / model.camera.focal_length_px * region.sampling.reduction
    opening = float(np.count_nonzero(seen)) * pixel_mm**2 / (np.pi * radius**2)
    to_noise = float(np.median(contrast[seen])) if np.any(seen) else 0.0
    return HoleView(hole.id, min(opening, 1.0), to_noise)


def residual_statistics(problem: Problem, solution: Solution, noise: NoiseModel) -> ResidualStatistics:
    """Size and structure of the residual."""
    region, residual = problem.model.region, solution.linear.residual
    most, visible = NAIL_EVIDENCE.clipped_deviations, solution.linear.visible
    standardised = np.clip(residual * np.sqrt(problem.weight), -most, most)
    smooth = _smoothed(region, standardised, NAIL_EVIDENCE.structure_blur_px)
    rim = (visible > NAIL_EVIDENCE.rim_from) & (visible < NAIL_EVIDENCE.rim_to)
    elsewhere = ~rim
    rms = float(np.sqrt(np.mean(residual**2))) * region.grey_scale
    reference = float(np.sqrt(np.mean(smooth[elsewhere] ** 2))) if np.any(elsewhere) else 1.0
    at_rims = float(np.sqrt(np.mean(smooth[rim] ** 2))) if np.any(rim) else 0.0
    inflation = float(noise.inflation.mean())
    return ResidualStatistics(rms, at_rims / max(reference, 1e-9), inflation, _spot(problem, solution, noise))


def _spot(problem: Problem, solution: Solution, noise: NoiseModel) -> float:
    """Largest smoothed residual at a hole, over the step from metal to background, where it is far beyond noise."""
    region, linear = problem.model.region, solution.linear
    near = np.zeros(len(region.compared), dtype=bool)
    for hole in problem.model.nail.holes:
        x, y = hole.axis.point_mm[:2]
        reach_mm = 0.5 * hole.diameter_mm + NAIL_EVIDENCE.about_hole_mm
        near |= np.hypot(region.along_mm - x, region.across_mm - y) < reach_mm
    step, blur_px = np.abs(_local_step(problem, solution)), NAIL_EVIDENCE.spot_blur_px
    deviations = np.abs(_smoothed(region, linear.residual / np.sqrt(noise.variance), blur_px))
    certain = deviations > NAIL_EVIDENCE.certain_deviations * MEDIAN_TO_DEVIATION * np.median(deviations)
    smallest_step = NAIL_EVIDENCE.least_step * np.median(step)
    share = np.abs(_smoothed(region, linear.residual, blur_px)) / np.maximum(step, smallest_step)
    return float(share[near & certain].max(initial=0.0))


def _local_step(problem: Problem, solution: Solution) -> NDArray[np.float64]:
    """From the grey value behind metal to the one without metal, under the guide's body, shape (N,)."""
    linear = solution.linear
    without_metal = visible_fraction_without_metal(problem.model, solution.parameters)
    return without_metal * (linear.background - linear.floor)


def _smoothed(region: FitRegion, values: NDArray[np.float64], blur_px: float) -> NDArray[np.float64]:
    """Values of the compared pixels, shape (N,), after a Gaussian, with zero around them."""
    image = np.zeros(region.shape)
    image.ravel()[region.compared] = values
    return blurred_image(image, blur_px).ravel()[region.compared]
