"""Penalised maximum likelihood by variable projection: pose and nuisances move, background and floor are solved for."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.equations import (
    Equations,
    Linear,
    Problem,
    Sensitivity,
    equations_at,
    solution_again,
    solution_at,
    with_gradient_at,
)
from services.registration.core.nail.tracing import chamfer_is_left
from services.registration.core.nail.unknowns import within_reason

_LEAST_CURVATURE = 1e-3
# Below the first of these, a step hardly depends on the damping; after a step that fails, less than the second would
# only fail once more.
_LEAST_DAMPING, _DAMPING_AFTER_FAILURE, _MOST_DAMPING = 1e-3, 0.1, 1e6
_DAMPING_FACTOR = 10.0
# A step that promises less than this part of the tolerance is not worth tracing the rays for.
_HOPELESS = 0.3
# A fit is given up when even so many times what the derivatives promise would leave it above what it may cost.
_TRUSTED_PROMISES = 5.0
# Derivatives are renewed once the parameters are so many standard deviations away: taking them costs three to four
# times what the rays cost, and that far they change by some per cent.
_CLOSE_DEVIATIONS = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """End of a fit: linear solution there; derivatives and projected normal matrix from where they were last taken.

    Most fits are steps on the way to another, and nobody asks for their derivatives: `with_derivatives` has them taken
    at the end where the last ones were too far away.

    `cost` is the sum of weighted squared residuals and priors (twice the negative logarithm of the likelihood, for
    independent pixels). `least_cost` is the same, but for a fit that was given up: what its end can hardly fall below.
    """

    linear: Linear
    moves: Sensitivity
    normal_matrix: NDArray[np.float64]
    steps: int
    converged: bool
    least_cost: float

    @property
    def parameters(self) -> NDArray[np.float64]:
        """Where the fit ended, shape (PARAMETERS,)."""
        return self.linear.traced.parameters

    @property
    def cost(self) -> float:
        """Twice the negative logarithm of the posterior, up to a constant."""
        return self.linear.cost


def minimise(
    problem: Problem, start: NDArray[np.float64], most_steps: int, tolerance: float, hopeless_cost: float = np.inf
) -> Solution:
    """Levenberg-Marquardt on the free parameters until a step lowers the cost by less than `tolerance`.

    Given up as soon as its end can hardly cost less than `hopeless_cost`.
    """
    return _descended(problem, solution_at(problem, start), most_steps, tolerance, hopeless_cost)


def minimise_from(problem: Problem, known: Linear, most_steps: int, tolerance: float) -> Solution:
    """The same from where this or another problem in the same scene has been solved."""
    return _descended(problem, solution_again(problem, known), most_steps, tolerance, np.inf)


def _descended(problem: Problem, here: Linear, most_steps: int, tolerance: float, hopeless_cost: float) -> Solution:
    damping, converged, steps = _LEAST_DAMPING, False, 0
    equations = equations_at(problem, here)
    while steps < most_steps and not converged:
        least_cost = here.cost - _TRUSTED_PROMISES * _promise(equations) if here.cost > hopeless_cost else here.cost
        if least_cost > hopeless_cost:
            return Solution(here, equations.moves, equations.normal_matrix, steps, converged, least_cost)
        steps += 1
        below, damping = _step_down(problem, here, equations, damping, tolerance)
        if below is None:
            converged = True
            break
        converged = here.cost - below.cost < tolerance
        here = below
        if not converged and steps < most_steps:
            equations = _equations_beside(problem, here, equations)
    return Solution(here, equations.moves, equations.normal_matrix, steps, converged, here.cost)


def with_derivatives(problem: Problem, solution: Solution) -> Solution:
    """The same end with derivatives and normal matrix from there or close by."""
    if _is_close(problem, solution.linear, solution.moves.at, solution.normal_matrix):
        return solution
    equations = equations_at(problem, solution.linear)
    return replace(solution, moves=equations.moves, normal_matrix=equations.normal_matrix)


def _equations_beside(problem: Problem, here: Linear, known: Equations) -> Equations:
    """The equations after a step from where they are known."""
    if _is_close(problem, here, known.moves.at, known.normal_matrix):
        return with_gradient_at(problem, here, known)
    return equations_at(problem, here)


def _promise(equations: Equations) -> float:
    """By how much the cost would fall if the model were as linear as it looks from here."""
    return float(equations.gradient @ np.linalg.lstsq(equations.normal_matrix, equations.gradient)[0])


def _step_down(
    problem: Problem,
    here: Linear,
    equations: Equations,
    damping: float,
    tolerance: float,
) -> tuple[Linear | None, float]:
    """Solution after a step that lowers the cost (None when none does by enough), and the damping for the next."""
    normal, gradient = equations.normal_matrix, equations.gradient
    scale = np.diag(np.maximum(np.diag(normal), _LEAST_CURVATURE))
    least_promise = _HOPELESS * tolerance
    while damping <= _MOST_DAMPING:
        step = np.linalg.solve(normal + damping * scale, gradient)
        if float(2.0 * gradient @ step - step @ normal @ step) < least_promise:
            break
        trial = here.traced.parameters.copy()
        trial[problem.free] += step
        below = solution_at(problem, within_reason(trial))
        if below.cost < here.cost:
            return below, max(damping / _DAMPING_FACTOR, _LEAST_DAMPING)
        damping = max(damping * _DAMPING_FACTOR, _DAMPING_AFTER_FAILURE)
        # after a broken promise, a step that promises less than the tolerance would end the fit: it is saved
        least_promise = tolerance
    return None, damping


def _is_close(problem: Problem, here: Linear, at: NDArray[np.float64], normal_matrix: NDArray[np.float64]) -> bool:
    """Whether derivatives taken elsewhere will do: fewer standard deviations away than change an edge's profile.

    Where the chamfer ends they change at once.
    """
    if chamfer_is_left(problem.scene, here.traced.parameters) != chamfer_is_left(problem.scene, at):
        return False
    way = (here.traced.parameters - at)[problem.free]
    return float(way @ normal_matrix @ way) < _CLOSE_DEVIATIONS**2
