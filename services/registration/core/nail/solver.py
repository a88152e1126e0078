"""Penalised maximum likelihood by variable projection: pose and nuisances move, background and floor are solved for."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from services.registration.core.nail.image_model import (
    Appearance,
    NailScene,
    prior_mean,
    prior_precision,
    render,
    render_with_derivatives,
    within_reason,
)
from services.registration.core.nail.texture import SplineField, accumulate_normal_equations

_LEAST_RIDGE = 1e-9
_LEAST_CURVATURE = 1e-3
_DAMPING_START = 1e-3
_DAMPING_FACTOR = 10.0
_DAMPING_LIMIT = 1e6


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """One least-squares problem.

    Attributes
    ----------
    grey
        Measured values, shape (N,) (those of the scene: whitened when the scene is).
    floor
        Basis of the grey value where nothing passes, shape (N, D).
    weight
        Inverse variance per compared pixel (zero where left out), shape (N,).
    texture_precision
        Inverse variance of the field's second differences.
    free
        Which parameters move, shape (PARAMETERS,).
    """

    scene: NailScene
    field: SplineField
    grey: NDArray[np.float64]
    floor: NDArray[np.float64]
    weight: NDArray[np.float64]
    texture_precision: float
    free: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Linear:
    """Solution for the parameters that enter linearly, at given other ones."""

    appearance: Appearance
    coefficients: NDArray[np.float64]
    background: NDArray[np.float64]
    floor: NDArray[np.float64]
    residual: NDArray[np.float64]
    cost: float
    factor: tuple[NDArray[np.float64], bool]


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """End of a fit: parameters, linear solution there, and the projected normal matrix of the free parameters.

    `cost` is the sum of weighted squared residuals and priors (twice the negative logarithm of the likelihood, for
    independent pixels).
    """

    parameters: NDArray[np.float64]
    linear: Linear
    normal_matrix: NDArray[np.float64]
    steps: int
    converged: bool

    @property
    def cost(self) -> float:
        """Twice the negative logarithm of the posterior, up to a constant."""
        return self.linear.cost


def solve_linear(problem: Problem, parameters: NDArray[np.float64], look: Appearance) -> Linear:
    """Best background and floor for a given appearance."""
    gain = look.visible * look.delrin
    dense = (1.0 - look.visible)[:, None] * problem.floor
    matrix, right = _normal_equations(problem, gain, dense, problem.grey[:, None])
    factor = cho_factor(matrix, lower=True, overwrite_a=True, check_finite=False)
    coefficients = cho_solve(factor, right, check_finite=False)[:, 0]
    size = problem.field.size
    background = problem.field.at_places(coefficients[:size])
    floor = problem.floor @ coefficients[size:]
    residual = problem.grey - gain * background - (1.0 - look.visible) * floor
    c = coefficients[:size]
    penalty = problem.texture_precision * float(c @ (problem.field.roughness @ c))
    excess = parameters - prior_mean()
    prior = float((prior_precision() * problem.free) @ excess**2)
    cost = float(problem.weight @ residual**2) + penalty + prior
    return Linear(look, coefficients, background, floor, residual, cost, factor)


def _normal_equations(
    problem: Problem, gain: NDArray[np.float64], dense: NDArray[np.float64], targets: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    field = problem.field
    total = field.size + dense.shape[1]
    matrix = np.zeros((total, total))
    right = np.zeros((total, targets.shape[1]))
    accumulate_normal_equations(
        field.corner,
        field.along_weights,
        field.across_weights,
        field.grid[1],
        gain,
        dense,
        problem.weight,
        targets,
        matrix,
        right,
    )
    matrix[: field.size, : field.size] += problem.texture_precision * field.roughness
    matrix[np.diag_indices(total)] += _LEAST_RIDGE * np.trace(matrix) / total
    return matrix, right


def minimise(problem: Problem, start: NDArray[np.float64], most_steps: int, tolerance: float) -> Solution:
    """Levenberg-Marquardt on the free parameters until a step lowers the cost by less than `tolerance`."""
    parameters = start.copy()
    damping = _DAMPING_START
    free = np.flatnonzero(problem.free)
    steps, converged = 0, False
    while True:
        look, derivatives = render_with_derivatives(problem.scene, parameters, problem.free)
        linear = solve_linear(problem, parameters, look)
        sensitivities = _sensitivities(linear, derivatives)
        normal, gradient = _projected(problem, parameters, linear, sensitivities)
        if steps >= most_steps or converged:
            break
        steps += 1
        while True:
            step = np.linalg.solve(normal + damping * np.diag(np.maximum(np.diag(normal), _LEAST_CURVATURE)), gradient)
            trial = parameters.copy()
            trial[free] += step
            trial = within_reason(trial)
            lower = solve_linear(problem, trial, render(problem.scene, trial)).cost
            if lower < linear.cost:
                damping = max(damping / _DAMPING_FACTOR, 1e-9)
                converged = linear.cost - lower < tolerance
                parameters = trial
                break
            damping *= _DAMPING_FACTOR
            if damping > _DAMPING_LIMIT:
                return Solution(parameters, linear, normal, steps, converged=True)
    return Solution(parameters, linear, normal, steps, converged)


def _sensitivities(linear: Linear, derivatives: list[Appearance]) -> NDArray[np.float64]:
    """Derivative of the modelled grey values by the free parameters, background and floor held, shape (N, P)."""
    look = linear.appearance
    columns = [
        d.visible * (look.delrin * linear.background - linear.floor) + d.delrin * look.visible * linear.background
        for d in derivatives
    ]
    return np.column_stack(columns)


def _projected(
    problem: Problem, parameters: NDArray[np.float64], linear: Linear, sensitivities: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Normal matrix and gradient of the free parameters after the linear ones have been eliminated."""
    look = linear.appearance
    dense = (1.0 - look.visible)[:, None] * problem.floor
    cross = _cross_terms(problem, look.visible * look.delrin, dense, sensitivities)
    weighted = problem.weight[:, None] * sensitivities
    normal = sensitivities.T @ weighted - cross.T @ cho_solve(linear.factor, cross, check_finite=False)
    precision = prior_precision()[problem.free]
    excess = (parameters - prior_mean())[problem.free]
    gradient = weighted.T @ linear.residual - precision * excess
    normal[np.diag_indices(len(precision))] += precision
    return normal, gradient


def _cross_terms(
    problem: Problem, gain: NDArray[np.float64], dense: NDArray[np.float64], columns: NDArray[np.float64]
) -> NDArray[np.float64]:
    """A'W columns, shape (M + D, P)."""
    return _normal_equations(problem, gain, dense, columns)[1]
