"""Penalised maximum likelihood by variable projection: pose and nuisances move, background and floor are solved for."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from services.registration.core.nail.appearance import Appearance, Paths, derivatives, paths, render
from services.registration.core.nail.scene import NailScene
from services.registration.core.nail.texture import SplineField, accumulate_normal_equations
from services.registration.core.nail.unknowns import prior_mean, prior_precision, within_reason
from shared.two_cores import on_both_halves

_LEAST_RIDGE = 1e-9
_LEAST_CURVATURE = 1e-3
# Below the first of these, a step hardly depends on the damping; after a step that fails, less than the second would
# only fail once more.
_LEAST_DAMPING, _DAMPING_AFTER_FAILURE, _MOST_DAMPING = 1e-3, 0.1, 1e6
_DAMPING_FACTOR = 10.0
# A step that promises less than this part of the tolerance is not worth tracing the rays for.
_HOPELESS = 0.3
# The normal equations of fewer are done sooner than handed to another core.
_LEAST_PIXELS = 5000
# Derivatives are renewed once the parameters are so many standard deviations away: taking them costs five times what
# the rays cost, and that far they change by some per cent.
_CLOSE_DEVIATIONS = 3.0


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

    traced: Paths
    appearance: Appearance
    background: NDArray[np.float64]
    floor: NDArray[np.float64]
    residual: NDArray[np.float64]
    cost: float
    factor: tuple[NDArray[np.float64], bool]


@dataclass(frozen=True, slots=True, eq=False)
class Sensitivity:
    """How the model moves with the free parameters, and what background and floor make up for.

    Attributes
    ----------
    at
        All parameters where `of_pixels` was taken, shape (PARAMETERS,).
    of_pixels
        Derivative of the modelled grey values, background and floor held, shape (N, P).
    of_linear
        Change of the coefficients of background and floor that follows, shape (M + D, P).
    cross
        A'W times the derivative, shape (M + D, P).
    """

    at: NDArray[np.float64]
    of_pixels: NDArray[np.float64]
    of_linear: NDArray[np.float64]
    cross: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class _Equations:
    """What a step follows from: derivatives, normal matrix, shape (P, P), and gradient, shape (P,)."""

    moves: Sensitivity
    normal_matrix: NDArray[np.float64]
    gradient: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """End of a fit: linear solution, derivatives there or close by, projected normal matrix of the free parameters.

    `cost` is the sum of weighted squared residuals and priors (twice the negative logarithm of the likelihood, for
    independent pixels).
    """

    linear: Linear
    moves: Sensitivity
    normal_matrix: NDArray[np.float64]
    steps: int
    converged: bool

    @property
    def parameters(self) -> NDArray[np.float64]:
        """Where the fit ended, shape (PARAMETERS,)."""
        return self.linear.traced.parameters

    @property
    def cost(self) -> float:
        """Twice the negative logarithm of the posterior, up to a constant."""
        return self.linear.cost


def solution_at(problem: Problem, parameters: NDArray[np.float64]) -> Linear:
    """Best background and floor at given other parameters."""
    return solution_for(problem, paths(problem.scene, parameters))


def solution_for(problem: Problem, traced: Paths) -> Linear:
    """Best background and floor where the rays have been traced already."""
    look = render(problem.scene, traced)
    gain = look.visible * look.delrin
    dense = (1.0 - look.visible)[:, None] * problem.floor
    matrix, right = _normal_equations(problem, gain, dense, problem.grey[:, None])
    factor = cho_factor(matrix, lower=True, overwrite_a=True, check_finite=False)
    coefficients = cho_solve(factor, right, check_finite=False)[:, 0]
    size = problem.field.size
    c = coefficients[:size]
    background = problem.field.at_places(c)
    floor = problem.floor @ coefficients[size:]
    residual = problem.grey - gain * background - (1.0 - look.visible) * floor
    penalty = problem.texture_precision * float(c @ (problem.field.roughness @ c))
    excess = traced.parameters - prior_mean()
    prior = float((prior_precision() * problem.free) @ excess**2)
    cost = float(problem.weight @ residual**2) + penalty + prior
    return Linear(traced, look, background, floor, residual, cost, factor)


def _normal_equations(
    problem: Problem, gain: NDArray[np.float64], dense: NDArray[np.float64], targets: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    field = problem.field
    total = field.size + dense.shape[1]

    def of_part(part: slice) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        sums = np.zeros((total, total)), np.zeros((total, targets.shape[1]))
        accumulate_normal_equations(
            field.order[part],
            field.corner,
            field.along_weights,
            field.across_weights,
            field.grid[1],
            gain,
            dense,
            problem.weight,
            targets,
            *sums,
        )
        return sums

    halves = on_both_halves(of_part, len(field.order), _LEAST_PIXELS)
    matrix, right = (np.sum(sums, axis=0) for sums in zip(*halves, strict=True))
    matrix[: field.size, : field.size] += problem.texture_precision * field.roughness
    matrix[np.diag_indices(total)] += _LEAST_RIDGE * np.trace(matrix) / total
    return matrix, right


def minimise(problem: Problem, start: NDArray[np.float64], most_steps: int, tolerance: float) -> Solution:
    """Levenberg-Marquardt on the free parameters until a step lowers the cost by less than `tolerance`."""
    return minimise_from(problem, paths(problem.scene, start), most_steps, tolerance)


def minimise_from(
    problem: Problem, traced: Paths, most_steps: int, tolerance: float, known: Sensitivity | None = None
) -> Solution:
    """The same where the start's rays have been traced already, perhaps with derivatives known from close by."""
    here, damping, converged, steps = solution_for(problem, traced), _LEAST_DAMPING, False, 0
    equations = _equations(problem, here, known)
    while steps < most_steps and not converged:
        steps += 1
        below, damping = _step_down(problem, here, equations, damping, tolerance)
        if below is None:
            converged = True
            break
        converged = here.cost - below.cost < tolerance
        here = below
        equations = _equations(problem, here, equations.moves if _is_close(problem, here, equations) else None)
    return Solution(here, equations.moves, equations.normal_matrix, steps, converged)


def _step_down(
    problem: Problem,
    here: Linear,
    equations: _Equations,
    damping: float,
    tolerance: float,
) -> tuple[Linear | None, float]:
    """Solution after a step that lowers the cost (None when none does by enough), and the damping for the next."""
    normal, gradient = equations.normal_matrix, equations.gradient
    scale = np.diag(np.maximum(np.diag(normal), _LEAST_CURVATURE))
    while damping <= _MOST_DAMPING:
        step = np.linalg.solve(normal + damping * scale, gradient)
        if float(2.0 * gradient @ step - step @ normal @ step) < _HOPELESS * tolerance:
            break
        trial = here.traced.parameters.copy()
        trial[problem.free] += step
        below = solution_at(problem, within_reason(trial))
        if below.cost < here.cost:
            return below, max(damping / _DAMPING_FACTOR, _LEAST_DAMPING)
        damping = max(damping * _DAMPING_FACTOR, _DAMPING_AFTER_FAILURE)
    return None, damping


def _is_close(problem: Problem, here: Linear, equations: _Equations) -> bool:
    """Whether derivatives taken elsewhere will do: fewer standard deviations away than change an edge's profile."""
    way = (here.traced.parameters - equations.moves.at)[problem.free]
    return float(way @ equations.normal_matrix @ way) < _CLOSE_DEVIATIONS**2


def _derivatives_at(problem: Problem, here: Linear) -> NDArray[np.float64]:
    """Of the modelled grey values, background and floor held, shape (N, P)."""
    look = here.appearance
    step = look.delrin * here.background - here.floor
    changes = derivatives(problem.scene, here.traced, look, problem.free)
    return np.column_stack([d.visible * step + d.delrin * look.visible * here.background for d in changes])


def _equations(problem: Problem, here: Linear, known: Sensitivity | None) -> _Equations:
    """Normal matrix and gradient of the free parameters with the linear ones eliminated."""
    look, at = here.appearance, here.traced.parameters
    if known is None:
        columns = _derivatives_at(problem, here)
    else:
        columns, at = known.of_pixels, known.at
    dense = (1.0 - look.visible)[:, None] * problem.floor
    cross = _normal_equations(problem, look.visible * look.delrin, dense, columns)[1]
    moves = Sensitivity(at, columns, cho_solve(here.factor, cross, check_finite=False), cross)
    weighted = problem.weight[:, None] * columns
    normal = columns.T @ weighted - cross.T @ moves.of_linear
    precision = prior_precision()[problem.free]
    excess = (here.traced.parameters - prior_mean())[problem.free]
    gradient = weighted.T @ here.residual - precision * excess
    normal[np.diag_indices(len(precision))] += precision
    return _Equations(moves, normal, gradient)
