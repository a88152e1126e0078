"""Penalised maximum likelihood by variable projection: pose and nuisance parameters move, the background is solved for.

At given pose and nuisance parameters, background and floor are the solution of a linear problem; the normal equations
of the others follow with those two eliminated, and Levenberg-Marquardt takes the steps.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.robust import robust_spread
from services.registration.core.nail.background import (
    BorderedFactor,
    DesignMatrix,
    SplineField,
    cholesky_factor,
    normal_equations_of,
    right_sides_of,
    spline_field,
)
from services.registration.core.nail.derivatives import visible_fraction_derivatives
from services.registration.core.nail.forward_model import (
    ForwardModel,
    StageSettings,
    TracedTransmission,
    trace_transmission,
    visible_fraction,
    visible_image,
)
from services.registration.core.nail.noise import NoiseModel, huber_precision, noise_model, whitening_filter
from services.registration.core.nail.parameters import (
    STRAIGHT_NAIL,
    chamfer,
    clipped_to_bounds,
    prior_mean,
    prior_precision,
)
from services.registration.core.nail.region import FitRegion
from services.registration.core.tuning import FIT_REGION, FOREIGN_OBJECTS, NAIL_NOISE, NAIL_SOLVER
from shared.geometry.parts import mean_hole_direction

# Guard: a parameter of no effect must not make the damped matrix singular.
_LEAST_CURVATURE = 1e-3
# Guard: pixels so far from all compared ones that no filter reaches from them to these.
_LEAST_SHARE = 1e-9
# Units of the floor's quadratic, which make its coefficients of one size.
_FLOOR_UNITS_MM = (20.0, 6.0)


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """One least-squares problem."""

    model: ForwardModel
    field: SplineField
    observed: NDArray[np.float64]  # measured values, shape (N,) (those of the model: whitened when it whitens)
    floor: NDArray[np.float64]  # basis of the grey value where nothing is transmitted, shape (N, D)
    weight: NDArray[np.float64]  # inverse variance per compared pixel, shape (N,)
    texture_precision: float  # inverse variance of the field's second differences
    free: NDArray[np.bool_]  # which parameters move, shape (PARAMETER_COUNT,)


@dataclass(frozen=True, slots=True, eq=False)
class LinearSolution:
    """Best background and floor of a problem at given other parameters."""

    model: ForwardModel
    traced: TracedTransmission
    visible: NDArray[np.float64]
    background: NDArray[np.float64]
    floor: NDArray[np.float64]
    residual: NDArray[np.float64]
    cost: float
    design: DesignMatrix
    factor: BorderedFactor


@dataclass(frozen=True, slots=True, eq=False)
class NormalEquations:
    """The linearised problem with background and floor eliminated."""

    at: NDArray[np.float64]  # all parameters where `jacobian` was evaluated, shape (PARAMETER_COUNT,)
    jacobian: NDArray[np.float64]  # derivative of the modelled grey values, background and floor held, shape (N, P)
    matrix: NDArray[np.float64]  # shape (P, P)
    gradient: NDArray[np.float64]  # shape (P,)


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """End of a fit: linear solution there, and the normal equations from where they were last evaluated.

    Most fits are steps on the way to another and need no derivatives at their end: `with_derivatives` evaluates them
    where the last ones were too far away.

    `least_cost` is the cost, but for an abandoned fit: a lower bound of what its end would cost.
    """

    linear: LinearSolution
    equations: NormalEquations
    steps: int
    converged: bool
    least_cost: float

    @property
    def parameters(self) -> NDArray[np.float64]:
        """Where the fit ended, shape (PARAMETER_COUNT,)."""
        return self.linear.traced.parameters

    @property
    def cost(self) -> float:
        """Twice the negative logarithm of the posterior, up to a constant: weighted squared residuals and priors."""
        return self.linear.cost

    @property
    def hole_direction_camera(self) -> NDArray[np.float64]:
        """Mean direction of the holes in the camera frame, shape (3,): two optima differ in it."""
        model = self.linear.model
        return model.pose(self.parameters).directions(mean_hole_direction(model.nail))


def problem_for(model: ForwardModel, stage: StageSettings, free: NDArray[np.bool_]) -> Problem:
    """Least-squares problem with the same weight for all pixels."""
    region = model.region
    field = spline_field(region.along_mm, region.across_mm, stage.knot_spacing_mm)
    weight = np.full(len(region.compared), NAIL_NOISE.assumed_sd**-2)
    return Problem(model, field, model.observed, _floor_basis(region), weight, stage.texture_sd**-2, free)


def _floor_basis(region: FitRegion) -> NDArray[np.float64]:
    """Grey value behind closed metal: scatter and glare vary slowly, like a quadratic in the region, shape (N, 6)."""
    x, y = region.along_mm / _FLOOR_UNITS_MM[0], region.across_mm / _FLOOR_UNITS_MM[1]
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


# The noise of a solution, and problems weighted by it


def estimate_noise(problem: Problem, linear: LinearSolution) -> NoiseModel:
    """Noise model of a solution's residuals."""
    modelled = problem.observed - linear.residual
    return noise_model(problem.model.region, linear.traced.transmission, modelled, linear.residual)


def reweighted(problem: Problem, linear: LinearSolution, noise: NoiseModel) -> Problem:
    """The same problem with every pixel weighted by its variance, outliers less.

    Divided by the inflation, the cost counts independent samples: only then do priors have their due weight.
    """
    return replace(problem, weight=huber_precision(linear.residual, noise.variance) / noise.inflation)


def evenly_weighted(problem: Problem, noise: NoiseModel) -> Problem:
    """The same problem with every pixel weighted by its variance, outliers like all others."""
    return replace(problem, weight=1.0 / (noise.variance * noise.inflation))


def with_hidden_filled(problem: Problem, linear: LinearSolution) -> tuple[Problem, LinearSolution]:
    """The same problem and solution with the modelled grey values where the image shows something else.

    Hidden pixels are not compared, but the whitening filter reaches from them into pixels that are.
    """
    region = problem.model.region
    if not region.hidden.any():
        return problem, linear
    modelled = modelled_image(problem.model, linear)
    grey = np.where(region.hidden, modelled, region.grey)
    filled = replace(problem, model=replace(problem.model, region=replace(region, grey=grey)))
    return filled, _linear_solution(filled, linear.traced, linear.visible)


def modelled_image(model: ForwardModel, linear: LinearSolution) -> NDArray[np.float64]:
    """Modelled grey values on the whole rectangle; background and floor of the compared pixels are spread smoothly."""
    region = model.region
    visible = visible_image(model, linear.traced)
    background, floor, present = (
        region.smoothed(values, FIT_REGION.fill_blur_px)
        for values in (linear.background, linear.floor, np.ones(len(region.compared)))
    )
    share = np.maximum(present, _LEAST_SHARE)
    return visible * (background / share) + (1.0 - visible) * (floor / share)


def whitened(problem: Problem, linear: LinearSolution) -> tuple[Problem, LinearSolution]:
    """The same problem on the whitened image with renewed weights, and its solution with the old ones."""
    noise = estimate_noise(problem, linear)
    model = replace(problem.model, whitening=whitening_filter(noise.dark, noise.bright, noise.brightness))
    filtered = replace(problem, model=model, observed=model.observed)
    after = _linear_solution(filtered, linear.traced, visible_fraction(model, linear.traced))
    return reweighted(filtered, after, estimate_noise(filtered, after)), after


# The linear part, and the normal equations of the others


def linear_solution_at(problem: Problem, parameters: NDArray[np.float64]) -> LinearSolution:
    """Best background and floor at given other parameters."""
    traced = trace_transmission(problem.model, parameters)
    return _linear_solution(problem, traced, visible_fraction(problem.model, traced))


def linear_solution_from(problem: Problem, known: LinearSolution) -> LinearSolution:
    """Best background and floor where this or another problem with the same model has been solved."""
    if problem.model is not known.model:
        raise ValueError("a solution can be reused only with the model it was found with: whitening changes the model")
    return _linear_solution(problem, known.traced, known.visible)


def _linear_solution(problem: Problem, traced: TracedTransmission, visible: NDArray[np.float64]) -> LinearSolution:
    hidden = 1.0 - visible
    design = DesignMatrix(problem.field, visible, hidden[:, None] * problem.floor, problem.weight)
    matrix, side = normal_equations_of(design, problem.observed, problem.texture_precision)
    factor = cholesky_factor(matrix)
    coefficients, size = factor.solved(side), problem.field.size
    c = coefficients[:size]
    background, floor = problem.field.at_places(c), problem.floor @ coefficients[size:]
    residual = problem.observed - visible * background - hidden * floor
    roughness = problem.texture_precision * float(c @ (problem.field.roughness @ c))
    prior = float((prior_precision() * problem.free) @ (traced.parameters - prior_mean()) ** 2)
    cost = float(problem.weight @ residual**2) + roughness + prior
    return LinearSolution(problem.model, traced, visible, background, floor, residual, cost, design, factor)


def normal_equations_at(problem: Problem, here: LinearSolution) -> NormalEquations:
    """Linearise a problem about its solution at some parameters."""
    return _equations(problem, here, _derivatives(here, problem.free))


def with_curvature(problem: Problem, solution: Solution) -> tuple[Problem, Solution]:
    """The same end of a straight nail's fit with the curvature free, and derivatives by it."""
    freed, here = replace(problem, free=problem.free | ~STRAIGHT_NAIL), solution.linear
    jacobian = np.column_stack([solution.equations.jacobian, _derivatives(here, ~STRAIGHT_NAIL)])
    return freed, replace(solution, equations=_equations(freed, here, jacobian))


def with_changes(
    problem: Problem, solution: Solution, changes: Sequence[NDArray[np.float64]], precision: float = 0.0
) -> Solution:
    """The same end with further derivatives of the visible fraction, shape (N,) each, after those by free parameters.

    The fit has what they belong to at zero, where a prior of a precision holds it.
    """
    here = solution.linear
    step = here.background - here.floor
    jacobian = np.column_stack([solution.equations.jacobian, *(change * step for change in changes)])
    equations = _equations(problem, here, jacobian)
    more = np.arange(solution.equations.jacobian.shape[1], jacobian.shape[1])
    equations.matrix[more, more] += precision
    return replace(solution, equations=equations)


def _derivatives(here: LinearSolution, free: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Derivatives of the modelled grey values by some parameters, background and floor held, shape (N, P)."""
    step = here.background - here.floor
    return np.column_stack([change * step for change in visible_fraction_derivatives(here.model, here.traced, free)])


def _equations(problem: Problem, here: LinearSolution, jacobian: NDArray[np.float64]) -> NormalEquations:
    cross = right_sides_of(here.design, jacobian)
    matrix = jacobian.T @ (problem.weight[:, None] * jacobian) - cross.T @ here.factor.solved(cross)
    precision = prior_precision()[problem.free]
    matrix[np.diag_indices(len(precision))] += precision
    return NormalEquations(here.traced.parameters, jacobian, matrix, _gradient(problem, here, jacobian))


def predicted_decrease(problem: Problem, here: LinearSolution) -> float:
    """By how much the cost would fall at the optimum of all free parameters, to second order."""
    equations = normal_equations_at(problem, here)
    return float(equations.gradient @ np.linalg.solve(equations.matrix, equations.gradient))


def _gradient(problem: Problem, here: LinearSolution, jacobian: NDArray[np.float64]) -> NDArray[np.float64]:
    """Half of the cost's descent by the free parameters, shape (P,).

    Background and floor may be held: at their optimum the cost does not change with them.
    """
    excess = (here.traced.parameters - prior_mean())[problem.free]
    gradient = np.asarray((problem.weight * here.residual) @ jacobian)
    gradient[: len(excess)] -= prior_precision()[problem.free] * excess
    return gradient


def linear_response(here: LinearSolution, changes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Coefficients of background and floor that fit changes of the grey values, shape (N, P); shape (M + D, P)."""
    return here.factor.solved(right_sides_of(here.design, changes))


# Levenberg-Marquardt


def minimise(
    problem: Problem, start: NDArray[np.float64], most_steps: int, tolerance: float, cost_limit: float = np.inf
) -> Solution:
    """Fit the free parameters until a step lowers the cost by less than `tolerance`.

    Abandoned as soon as its end can hardly cost less than `cost_limit`.
    """
    return _levenberg_marquardt(problem, linear_solution_at(problem, start), most_steps, tolerance, cost_limit)


def minimise_from(problem: Problem, known: LinearSolution, most_steps: int, tolerance: float) -> Solution:
    """The same from where this or another problem with the same model has been solved."""
    return _levenberg_marquardt(problem, linear_solution_from(problem, known), most_steps, tolerance, np.inf)


def _levenberg_marquardt(
    problem: Problem, here: LinearSolution, most_steps: int, tolerance: float, cost_limit: float
) -> Solution:
    damping, converged, steps = NAIL_SOLVER.least_damping, False, 0
    equations = normal_equations_at(problem, here)
    while steps < most_steps and not converged:
        least_cost = _least_cost(here, equations, cost_limit)
        if least_cost > cost_limit:
            return Solution(here, equations, steps, converged, least_cost)
        steps += 1
        below, damping = _step_down(problem, here, equations, damping, tolerance)
        if below is None:
            converged = True
            break
        converged = here.cost - below.cost < tolerance
        here = below
        if not converged and steps < most_steps:
            equations = _renewed(problem, here, equations)
    return Solution(here, equations, steps, converged, here.cost)


def trimmed(problem: Problem, here: LinearSolution, most_steps: int, tolerance: float) -> Solution:
    """A fit in which what is darker than the model hardly counts: metal only ever darkens.

    Whatever lies over the nail is darker than the nail alone; what a wrong pose leaves bright keeps its weight. In the
    cost, what is darker counts as if it were just too dark.
    """
    for _ in range(FOREIGN_OBJECTS.trimmed_rounds):
        dark = here.residual < -FOREIGN_OBJECTS.trimmed_from_spreads * robust_spread(here.residual)
        weight = problem.weight * np.where(dark, FOREIGN_OBJECTS.trimmed_weight, 1.0)
        end = minimise_from(replace(problem, weight=weight), here, most_steps, tolerance)
        here = end.linear
    just_too_dark = FOREIGN_OBJECTS.trimmed_from_spreads * robust_spread(here.residual)
    cost = here.cost + float(np.sum(problem.weight[dark])) * just_too_dark**2
    return replace(end, linear=replace(here, cost=cost))


def with_derivatives(problem: Problem, solution: Solution) -> Solution:
    """The same end with normal equations from there or close by."""
    if _is_close(problem, solution.linear, solution.equations):
        return solution
    return replace(solution, equations=normal_equations_at(problem, solution.linear))


def _renewed(problem: Problem, here: LinearSolution, known: NormalEquations) -> NormalEquations:
    """The equations after a step; close to where they are known, only the gradient is another."""
    if _is_close(problem, here, known):
        return replace(known, gradient=_gradient(problem, here, known.jacobian))
    return normal_equations_at(problem, here)


def _least_cost(here: LinearSolution, equations: NormalEquations, cost_limit: float) -> float:
    """The cost; beyond the limit, what it can hardly fall below: several times the predicted decrease less."""
    if here.cost <= cost_limit:
        return here.cost
    decrease = float(equations.gradient @ np.linalg.lstsq(equations.matrix, equations.gradient)[0])
    return here.cost - NAIL_SOLVER.trusted_decreases * decrease


def _step_down(
    problem: Problem,
    here: LinearSolution,
    equations: NormalEquations,
    damping: float,
    tolerance: float,
) -> tuple[LinearSolution | None, float]:
    """Solution after a step that lowers the cost (None when none does by enough), and the damping for the next."""
    matrix, gradient = equations.matrix, equations.gradient
    scale = np.diag(np.maximum(np.diag(matrix), _LEAST_CURVATURE))
    least_decrease = NAIL_SOLVER.useless_share * tolerance
    while damping <= NAIL_SOLVER.largest_damping:
        step = np.linalg.solve(matrix + damping * scale, gradient)
        if float(2.0 * gradient @ step - step @ matrix @ step) < least_decrease:
            break
        trial = here.traced.parameters.copy()
        trial[problem.free] += step
        below = linear_solution_at(problem, clipped_to_bounds(trial))
        if below.cost < here.cost:
            return below, max(damping / NAIL_SOLVER.damping_factor, NAIL_SOLVER.least_damping)
        damping = max(damping * NAIL_SOLVER.damping_factor, NAIL_SOLVER.damping_after_failure)
        # after a step that failed, one predicted to gain less than the tolerance would end the fit: it is saved
        least_decrease = tolerance
    return None, damping


def _is_close(problem: Problem, here: LinearSolution, known: NormalEquations) -> bool:
    """Whether the equations hold here: fewer standard deviations away than change an edge's profile.

    Where the chamfer ends, derivatives change at once. Renewing them costs three to four times what the rays cost.
    """
    nail, parameters = problem.model.nail, here.traced.parameters
    if (chamfer(nail, parameters)[0] > 0.0) != (chamfer(nail, known.at)[0] > 0.0):
        return False
    way = (parameters - known.at)[problem.free]
    return float(way @ known.matrix @ way) < NAIL_SOLVER.close_deviations**2
