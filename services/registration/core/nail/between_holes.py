"""One hole against the other: how far each is turned from what the pose says of all.

A file says how the holes' axes lie to one another, and the fit takes that as exact. Holes drilled askew, a display that
changed the brightness of one rim, or a thing over it leave each hole with a turn of its own. Turns of the holes against
one another do not follow from the pose: one Gauss-Newton step estimates them, from the rims of each hole.
"""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.covariance import covariance_by
from services.registration.core.nail.derivatives import turns_of_holes
from services.registration.core.nail.least_squares import Problem, Solution, with_turned_holes
from services.registration.core.nail.noise import NoiseModel
from services.registration.core.nail.parameters import prior_precision
from services.registration.core.tuning import MODEL_ERRORS


def turns_between_holes(problem: Problem, solution: Solution, noise: NoiseModel) -> NDArray[np.float64]:
    """Mean square of the holes' own turns across their axes, beyond what noise explains, in rad², shape (2, 2).

    By the method of moments: what is expected of noise and of the model's own errors is taken off, so that holes which
    lie as filed hardly count. Zero for a nail with one hole.
    """
    holes = len(problem.model.nail.holes)
    if holes == 1:
        return np.zeros((2, 2))
    turned = with_turned_holes(problem, solution)
    count = 2 * (holes - 1)
    inverse = np.asarray(np.linalg.inv(turned.equations.matrix))[-count:]
    found = inverse @ turned.equations.gradient
    precision = np.concatenate([prior_precision()[problem.free], np.zeros(count)])
    own = turns_of_holes(holes)
    by_model = np.radians(MODEL_ERRORS.tilt_deg) ** 2 * np.linalg.inv(own.T @ own)
    expected = covariance_by(problem, turned, noise, inverse, precision) + np.kron(by_model, np.eye(2))
    chi_square = float(found @ np.linalg.solve(expected, found))
    turns = own @ found.reshape(holes - 1, 2)
    return np.asarray(max(1.0 - count / max(chi_square, count), 0.0) * turns.T @ turns / holes)
