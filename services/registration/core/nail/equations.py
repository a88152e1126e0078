"""The least-squares problem, what solves its linear part, and the normal equations of what is left.

Variable projection: at given pose and nuisances, background and floor are solved for; the others' equations follow with
those two eliminated.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from services.registration.core.nail.appearance import Appearance, derivatives, render
from services.registration.core.nail.scene import NailScene
from services.registration.core.nail.texture import SplineField, accumulate_normal_equations
from services.registration.core.nail.tracing import Paths, paths
from services.registration.core.nail.unknowns import prior_mean, prior_precision
from shared.two_cores import on_both_halves

_LEAST_RIDGE = 1e-9
# The normal equations of fewer are done sooner than handed to another core.
_LEAST_PIXELS = 5000


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
class Equations:
    """What a step follows from: derivatives, normal matrix, shape (P, P), and gradient, shape (P,)."""

    moves: Sensitivity
    normal_matrix: NDArray[np.float64]
    gradient: NDArray[np.float64]


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


def _derivatives_at(problem: Problem, here: Linear) -> NDArray[np.float64]:
    """Of the modelled grey values, background and floor held, shape (N, P)."""
    look = here.appearance
    step = look.delrin * here.background - here.floor
    changes = derivatives(problem.scene, here.traced, look, problem.free)
    return np.column_stack([d.visible * step + d.delrin * look.visible * here.background for d in changes])


def equations_at(problem: Problem, here: Linear, known: Sensitivity | None) -> Equations:
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
    return Equations(moves, normal, gradient)
