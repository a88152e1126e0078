"""What is in the nail's holes: marrow, bone, blood or cement, where other tissue is beside the nail.

The background continues smoothly through the holes. Where they hold what attenuates more, openings are darker than it;
the fit may explain that by more metal in the rays' way, and so by more tilt. How much they hold shows well, but not
always how much of the tilt is owed to it: the pose is uncertain by what content would change.
"""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.pose_estimate import POSE_SIZE
from services.registration.core.nail.attenuation import path_behind
from services.registration.core.nail.covariance import found_beyond_noise
from services.registration.core.nail.derivatives import derivatives_by_transmission
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


def motion_by_content(problem: Problem, solution: Solution, noise: NoiseModel) -> NDArray[np.float64]:
    """Small motion of the nail by the content that its holes seem to have, beyond what is usual, shape (6,).

    One Gauss-Newton step estimates the content, the same in all holes, and how it changes across them, beside all free
    parameters. What noise and usual tissue explain of it is taken off by the method of moments.
    """
    changes = _derivatives_by_content(problem.model, solution.linear.traced)
    count, precision = len(changes), HOLE_CONTENT.possible_sd_per_mm**-2
    filled = with_changes(problem, solution, changes, precision)
    usual = HOLE_CONTENT.usual_sd_per_mm**2 * np.eye(count)
    found_per_mm, share = found_beyond_noise(problem, filled, noise, usual, precision)
    # with the content held at what was found, the free parameters follow it
    free = len(filled.equations.matrix) - count
    by_content = filled.equations.matrix[:free, free:] @ found_per_mm
    followed = -np.linalg.solve(filled.equations.matrix[:free, :free], by_content)
    motion = problem.model.motion_by_parameters(solution.parameters) @ followed[:POSE_SIZE]
    return np.asarray(np.sqrt(share) * motion)


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
