"""What is in the nail's holes: marrow, bone, blood or cement, where other tissue is beside the nail.

The background continues smoothly through the holes. Where they hold what attenuates more, openings are darker than it;
the fit may explain that by more metal in the rays' way, and so by more tilt. How much they hold shows well, but not
always how much of the tilt is owed to it: the pose is uncertain by what content would change.
"""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.pose_estimate import POSE_SIZE
from services.registration.core.nail.attenuation import path_behind
from services.registration.core.nail.covariance import covariance_by
from services.registration.core.nail.derivatives import derivative_by_transmission
from services.registration.core.nail.forward_model import (
    ForwardModel,
    TracedTransmission,
    nail_shape,
    trace_metal,
)
from services.registration.core.nail.least_squares import Problem, Solution, with_changes
from services.registration.core.nail.noise import NoiseModel
from services.registration.core.nail.parameters import prior_precision
from services.registration.core.tuning import HOLE_CONTENT


def motion_by_content(problem: Problem, solution: Solution, noise: NoiseModel) -> NDArray[np.float64]:
    """Small motion of the nail by the content that its holes seem to have, beyond what is usual, shape (6,).

    One Gauss-Newton step estimates the content, the same in all holes, beside all free parameters. What noise and
    usual tissue explain of it is taken off by the method of moments.
    """
    precision = HOLE_CONTENT.possible_sd_per_mm**-2
    by_content = derivative_by_content(problem.model, solution.linear.traced)
    filled = with_changes(problem, solution, [by_content], precision)
    inverse = np.asarray(np.linalg.inv(filled.equations.matrix))
    found_per_mm = float(inverse[-1] @ filled.equations.gradient)
    priors = np.append(prior_precision()[problem.free], precision)
    by_noise = float(covariance_by(problem, filled, noise, inverse[-1:], priors)[0, 0])
    expected = by_noise + HOLE_CONTENT.usual_sd_per_mm**2
    share = max(1.0 - expected / max(found_per_mm**2, expected), 0.0)
    # with the content held at what was found, the free parameters follow it
    followed = inverse[:POSE_SIZE, -1] / inverse[-1, -1]
    motion = problem.model.motion_by_parameters(solution.parameters) @ followed
    return np.asarray(np.sqrt(share) * found_per_mm * motion)


def derivative_by_content(model: ForwardModel, traced: TracedTransmission) -> NDArray[np.float64]:
    """Derivative of `visible_fraction` by the attenuation in all holes over that beside the nail (1/mm), shape (N,)."""
    shape, support = nail_shape(model, traced.parameters), model.region.support
    without_bores = shape._replace(bores=np.ascontiguousarray(shape.bores[..., :0, :]))
    solid = trace_metal(model, traced.parameters, without_bores)
    drilled, whole = (of.transmission.ravel()[support] for of in (traced, solid))
    # through the bores a ray goes as far as its path in metal is shorter than in a nail without holes
    bore_mm = np.maximum(path_behind(whole, shape.material) - path_behind(drilled, shape.material), 0.0)
    change = -bore_mm * drilled
    return derivative_by_transmission(model, traced, model.region.on_rectangle(change.astype(np.float32), 0.0))
