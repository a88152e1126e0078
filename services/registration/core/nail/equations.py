"""The least-squares problem, what solves its linear part, and the normal equations of what is left.

Variable projection: at given pose and nuisances, background and floor are solved for; the others' equations follow with
those two eliminated.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.appearance import derivatives_of_share, visible_share
from services.registration.core.nail.bordered import BorderedMatrix, Factor, factorised
from services.registration.core.nail.scene import NailScene
from services.registration.core.nail.texture import SplineField
from services.registration.core.nail.texture_sums import Columns, add_normal_equations, add_right_sides, columns_of
from services.registration.core.nail.tracing import Paths, paths
from services.registration.core.nail.unknowns import prior_mean, prior_precision
from shared.two_cores import on_both_halves

_LEAST_RIDGE = 1e-9
# The normal equations of fewer are done sooner than handed to another core.
_LEAST_CELLS = 100


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
    """Solution for the parameters that enter linearly, at given other ones, of a problem in a scene."""

    scene: NailScene
    traced: Paths
    visible: NDArray[np.float64]
    background: NDArray[np.float64]
    floor: NDArray[np.float64]
    residual: NDArray[np.float64]
    cost: float
    factor: Factor


@dataclass(frozen=True, slots=True, eq=False)
class Sensitivity:
    """How the model moves with the free parameters.

    Attributes
    ----------
    at
        All parameters where `of_pixels` was taken, shape (PARAMETERS,).
    of_pixels
        Derivative of the modelled grey values, background and floor held, shape (N, P).
    """

    at: NDArray[np.float64]
    of_pixels: NDArray[np.float64]


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
    return _solution(problem, traced, visible_share(problem.scene, traced))


def solution_again(problem: Problem, known: Linear) -> Linear:
    """Best background and floor of this or another problem in the same scene, where one has been solved."""
    if problem.scene is not known.scene:
        raise ValueError("a solution can be had again only in the scene it was found in: whitening changes the scene")
    return _solution(problem, known.traced, known.visible)


def _solution(problem: Problem, traced: Paths, visible: NDArray[np.float64]) -> Linear:
    columns = _columns(problem, visible)
    matrix, side = _normal_equations(problem, columns)
    factor = factorised(matrix)
    coefficients = factor.solved(side)
    size = problem.field.size
    c = coefficients[:size]
    background = problem.field.at_places(c)
    floor = problem.floor @ coefficients[size:]
    residual = problem.grey - columns.gain * background - (1.0 - visible) * floor
    penalty = problem.texture_precision * float(c @ (problem.field.roughness @ c))
    excess = traced.parameters - prior_mean()
    prior = float((prior_precision() * problem.free) @ excess**2)
    cost = float(problem.weight @ residual**2) + penalty + prior
    return Linear(problem.scene, traced, visible, background, floor, residual, cost, factor)


def _columns(problem: Problem, visible: NDArray[np.float64]) -> Columns:
    """What background and floor act through."""
    dense = (1.0 - visible)[:, None] * problem.floor
    return columns_of(problem.field, visible, dense, problem.weight)


def _normal_equations(problem: Problem, columns: Columns) -> tuple[BorderedMatrix, NDArray[np.float64]]:
    """A'WA and the background's prior, for M + D coefficients, and A'W grey, shape (M + D,)."""
    size, dense = problem.field.size, columns.dense.shape[1]
    width = problem.field.roughness_band.shape[1]

    def of_part(part: slice) -> tuple[NDArray[np.float64], ...]:
        matrix, side = BorderedMatrix.of_zeros(size, width, dense), np.zeros(size + dense)
        add_normal_equations(columns, part.start, part.stop, problem.grey, matrix, side)
        return (*matrix, side)

    halves = on_both_halves(of_part, len(columns.cells) - 1, _LEAST_CELLS)
    band, border, corner, side = (_total(parts) for parts in zip(*halves, strict=True))
    band += problem.texture_precision * problem.field.roughness_band
    matrix = BorderedMatrix(band, border, corner)
    matrix.add_to_diagonal(_LEAST_RIDGE)
    return matrix, side


def _right_sides(columns: Columns, targets: NDArray[np.float64]) -> NDArray[np.float64]:
    """A'W times targets, shape (N, T); the result has shape (M + D, T)."""
    total = columns.coefficients + columns.dense.shape[1]

    def of_part(part: slice) -> NDArray[np.float64]:
        sides = np.zeros((total, targets.shape[1]))
        add_right_sides(columns, part.start, part.stop, targets, sides)
        return sides

    return _total(on_both_halves(of_part, len(columns.cells) - 1, _LEAST_CELLS))


def _total(parts: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Sum of arrays that nobody else needs, in the first of them."""
    total, *others = parts
    for other in others:
        total += other
    return total


def _derivatives_at(problem: Problem, here: Linear) -> NDArray[np.float64]:
    """Of the modelled grey values, background and floor held, shape (N, P)."""
    step = here.background - here.floor
    changes = derivatives_of_share(problem.scene, here.traced, problem.free)
    return np.column_stack([change * step for change in changes])


def equations_at(problem: Problem, here: Linear) -> Equations:
    """Normal matrix and gradient of the free parameters with the linear ones eliminated."""
    columns = _derivatives_at(problem, here)
    cross = _right_sides(_columns(problem, here.visible), columns)
    normal = columns.T @ (problem.weight[:, None] * columns) - cross.T @ here.factor.solved(cross)
    normal[np.diag_indices(len(normal))] += prior_precision()[problem.free]
    return Equations(Sensitivity(here.traced.parameters, columns), normal, _gradient(problem, here, columns))


def followed_by_linear(problem: Problem, here: Linear, columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Coefficients of background and floor that make up best for changes of the grey values, shape (N, P).

    The result has shape (M + D, P).
    """
    return here.factor.solved(_right_sides(_columns(problem, here.visible), columns))


def with_gradient_at(problem: Problem, here: Linear, known: Equations) -> Equations:
    """The same equations a small way on, where only the gradient is another."""
    return replace(known, gradient=_gradient(problem, here, known.moves.of_pixels))


def _gradient(problem: Problem, here: Linear, columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Half of the cost's fall by the free parameters, shape (P,).

    The linear ones may be held: at their optimum the cost does not change with them.
    """
    excess = (here.traced.parameters - prior_mean())[problem.free]
    return np.asarray((problem.weight * here.residual) @ columns - prior_precision()[problem.free] * excess)
