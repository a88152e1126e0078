"""What is in the nail's holes: marrow, bone, blood or cement, where other tissue is beside the nail.

The background continues smoothly through the holes. Where they hold what attenuates more, openings are darker than it;
the fit may explain that by more metal in the rays' way, and so by more tilt. How much they hold shows well, but not
always how much of the tilt is owed to it: the pose is uncertain by what content would change.

Where openings are brighter than it, bone was removed in line with the holes, as by a drill. The edges of such bores
look like rims of the nail, and the fit may follow them: the pose is uncertain by how bright they are.
"""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.pose_estimate import POSE_SIZE
from services.registration.core.nail.attenuation import path_behind
from services.registration.core.nail.covariance import further_parameters, share_beyond
from services.registration.core.nail.derivatives import derivatives_by_transmission
from services.registration.core.nail.evidence import covariance_of_turns
from services.registration.core.nail.forward_model import (
    ForwardModel,
    TracedTransmission,
    nail_shape,
    trace_metal,
)
from services.registration.core.nail.least_squares import Problem, Solution, with_changes
from services.registration.core.nail.noise import NoiseModel
from services.registration.core.nail.region import nail_plane
from services.registration.core.tuning import HOLE_CONTENT
from shared.geometry.parts import Hole, place_of_hole

# Mean place in half of a disc, over its radius.
_MEAN_OF_HALF = 4.0 / (3.0 * np.pi)
# Guard: a content that rises nowhere has no brighter half.
_LEAST_RISE_PER_MM = 1e-9


def covariance_by_content(problem: Problem, solution: Solution, noise: NoiseModel) -> NDArray[np.float64]:
    """Covariance of the nail's small motion by what its holes seem to hold, beyond what is usual, shape (6, 6).

    One Gauss-Newton step estimates the content, the same in all holes, and how it changes across them, beside all free
    parameters. What noise and usual tissue explain of it is taken off by the method of moments.
    """
    changes = _derivatives_by_content(problem.model, solution.linear.traced)
    count, precision = len(changes), HOLE_CONTENT.possible_sd_per_mm**-2
    filled = with_changes(problem, solution, changes, precision)
    found_per_mm, covariance = further_parameters(problem, filled, noise, count, precision)
    share = share_beyond(found_per_mm, covariance + HOLE_CONTENT.usual_sd_per_mm**2 * np.eye(count))
    # with the content held at what was found, the free parameters follow it
    free = len(filled.equations.matrix) - count
    by_content = filled.equations.matrix[:free, free:] @ found_per_mm
    followed = -np.linalg.solve(filled.equations.matrix[:free, :free], by_content)
    motion = problem.model.motion_by_parameters(solution.parameters) @ followed[:POSE_SIZE]
    bright_rad = np.radians(HOLE_CONTENT.turn_deg_mm * _bright_per_mm(found_per_mm, covariance))
    by_bores = covariance_of_turns(problem.model.nail, 0.5 * bright_rad**2 * np.eye(2))
    return np.asarray(share * np.outer(motion, motion) + by_bores)


def _bright_per_mm(found_per_mm: NDArray[np.float64], covariance: NDArray[np.float64]) -> float:
    """By how much the brighter halves of the openings attenuate less than what is beside the nail, beyond noise."""
    rise = float(np.linalg.norm(found_per_mm[1:]))
    towards = -_MEAN_OF_HALF * found_per_mm[1:] / max(rise, _LEAST_RISE_PER_MM)
    of_half = np.array([1.0, *towards])
    brighter = -float(of_half @ found_per_mm)
    expected = float(of_half @ covariance @ of_half) + HOLE_CONTENT.usual_bright_per_mm**2
    return float(np.sqrt(max(max(brighter, 0.0) ** 2 - expected, 0.0)))


def _derivatives_by_content(model: ForwardModel, traced: TracedTransmission) -> list[NDArray[np.float64]]:
    """Derivatives of `visible_fraction`, shape (N,) each, by the attenuation in all holes over that beside the nail.

    By that in their middles (1/mm), and by its increase from there to the wall along the nail and across it (1/mm).
    """
    shape, support = nail_shape(model, traced.parameters), model.region.support
    without_bores = shape._replace(bores=np.ascontiguousarray(shape.bores[..., :0, :]))
    solid = trace_metal(model, traced.parameters, without_bores)
    drilled, whole = (of.transmission.ravel()[support] for of in (traced, solid))
    # through the bores a ray goes as far as its path in metal is shorter than in a nail without holes
    bore_mm = np.maximum(path_behind(whole, shape.material) - path_behind(drilled, shape.material), 0.0)
    change = -bore_mm * drilled
    changes = [change, *(change * place for place in _places_in_holes(model, traced.parameters))]
    on_rectangle = [model.region.on_rectangle(values.astype(np.float32), 0.0) for values in changes]
    return derivatives_by_transmission(model, traced, on_rectangle)


def _places_in_holes(model: ForwardModel, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where the support's rays pass the nearest hole: -1 to 1 from wall to wall, along and across the nail, (2, S)."""
    x_mm, y_mm = nail_plane(model.region.rays.slopes, model.pose(parameters))

    def places(hole: Hole) -> NDArray[np.float64]:
        middle_x_mm, middle_y_mm = place_of_hole(model.nail, hole)
        radius_mm = 0.5 * hole.diameter_mm
        along, across = (x_mm - middle_x_mm) / (radius_mm + hole.half_slot_mm), (y_mm - middle_y_mm) / radius_mm
        return np.stack([along, across])

    of_holes = np.stack([places(hole) for hole in model.nail.holes])
    nearest = np.argmin(np.linalg.norm(of_holes, axis=1), axis=0)
    return np.clip(of_holes[nearest, :, np.arange(len(nearest))].T, -1.0, 1.0)
