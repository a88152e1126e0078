"""Penalised maximum likelihood by variable projection: pose and nuisance parameters move, the background is solved for.

At given pose and nuisance parameters, background and floor are the solution of a linear problem; the normal equations
of the others follow with those two eliminated.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.background import (
    BorderedFactor,
    BorderedMatrix,
    DesignMatrix,
    SplineField,
    add_normal_equations,
    add_right_sides,
    cholesky_factor,
    design_matrix,
    spline_field,
)
from services.registration.core.nail.forward_model import (
    Detail,
    ForwardModel,
    TracedTransmission,
    has_chamfer,
    paths,
    visible_fraction,
    visible_fraction_derivatives,
)
from services.registration.core.nail.imaging_chain import blurred_image
from services.registration.core.nail.noise import (
    NoiseCorrelation,
    noise_correlation,
    robust_weight,
    variance_by_brightness,
    whitening_filter,
)
from services.registration.core.nail.parameters import (
    PARAMETER_COUNT,
    clipped_to_bounds,
    prior_mean,
    prior_precision,
)
from services.registration.core.nail.region import FitRegion
from shared.two_cores import mapped, on_both_halves

_LEAST_RIDGE = 1e-9
# The normal equations of fewer are done sooner than handed to another core.
_LEAST_CELLS = 100

ALL_PARAMETERS = np.ones(PARAMETER_COUNT, dtype=bool)
_ASSUMED_NOISE = 0.025
_CLIPPED_DEVIATIONS = 4.0
_BRIGHTNESS_BLUR_PX = 1.5
_LEAST_OF_A_KIND = 400

_LEAST_CURVATURE = 1e-3
# Below the first of these, a step hardly depends on the damping; after a step that fails, less than the second would
# only fail once more.
_LEAST_DAMPING, _DAMPING_AFTER_FAILURE, _MOST_DAMPING = 1e-3, 0.1, 1e6
_DAMPING_FACTOR = 10.0
# A step that promises less than this part of the tolerance is not worth tracing the rays for.
_HOPELESS = 0.3
# A fit is given up when even so many times what the derivatives promise would leave it above what it may cost.
_TRUSTED_DECREASES = 5.0
# Derivatives are renewed once the parameters are so many standard deviations away: taking them costs three to four
# times what the rays cost, and that far they change by some per cent.
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
        Which parameters move, shape (PARAMETER_COUNT,).
    """

    model: ForwardModel
    field: SplineField
    grey: NDArray[np.float64]
    floor: NDArray[np.float64]
    weight: NDArray[np.float64]
    texture_precision: float
    free: NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class LinearSolution:
    """Solution for the parameters that enter linearly, at given other ones, of a problem in a scene."""

    model: ForwardModel
    traced: TracedTransmission
    visible: NDArray[np.float64]
    background: NDArray[np.float64]
    floor: NDArray[np.float64]
    residual: NDArray[np.float64]
    cost: float
    factor: BorderedFactor


@dataclass(frozen=True, slots=True, eq=False)
class Sensitivity:
    """How the model moves with the free parameters.

    Attributes
    ----------
    at
        All parameters where `of_pixels` was taken, shape (PARAMETER_COUNT,).
    of_pixels
        Derivative of the modelled grey values, background and floor held, shape (N, P).
    """

    at: NDArray[np.float64]
    of_pixels: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class NormalEquations:
    """What a step follows from: derivatives, normal matrix, shape (P, P), and gradient, shape (P,)."""

    moves: Sensitivity
    normal_matrix: NDArray[np.float64]
    gradient: NDArray[np.float64]


def linear_solution_at(problem: Problem, parameters: NDArray[np.float64]) -> LinearSolution:
    """Best background and floor at given other parameters."""
    return linear_solution_for(problem, paths(problem.model, parameters))


def linear_solution_for(problem: Problem, traced: TracedTransmission) -> LinearSolution:
    """Best background and floor where the rays have been traced already."""
    return _solution(problem, traced, visible_fraction(problem.model, traced))


def linear_solution_from(problem: Problem, known: LinearSolution) -> LinearSolution:
    """Best background and floor of this or another problem in the same scene, where one has been solved."""
    if problem.model is not known.model:
        raise ValueError("a solution can be had again only in the scene it was found in: whitening changes the scene")
    return _solution(problem, known.traced, known.visible)


def _solution(problem: Problem, traced: TracedTransmission, visible: NDArray[np.float64]) -> LinearSolution:
    columns = _columns(problem, visible)
    matrix, side = _normal_equations(problem, columns)
    factor = cholesky_factor(matrix)
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
    return LinearSolution(problem.model, traced, visible, background, floor, residual, cost, factor)


def _columns(problem: Problem, visible: NDArray[np.float64]) -> DesignMatrix:
    """What background and floor act through."""
    dense = (1.0 - visible)[:, None] * problem.floor
    return design_matrix(problem.field, visible, dense, problem.weight)


def _normal_equations(problem: Problem, columns: DesignMatrix) -> tuple[BorderedMatrix, NDArray[np.float64]]:
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


def _right_sides(columns: DesignMatrix, targets: NDArray[np.float64]) -> NDArray[np.float64]:
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


def _derivatives_at(problem: Problem, here: LinearSolution) -> NDArray[np.float64]:
    """Of the modelled grey values, background and floor held, shape (N, P)."""
    step = here.background - here.floor
    changes = visible_fraction_derivatives(problem.model, here.traced, problem.free)
    return np.column_stack([change * step for change in changes])


def normal_equations_at(problem: Problem, here: LinearSolution) -> NormalEquations:
    """Normal matrix and gradient of the free parameters with the linear ones eliminated."""
    columns = _derivatives_at(problem, here)
    cross = _right_sides(_columns(problem, here.visible), columns)
    normal = columns.T @ (problem.weight[:, None] * columns) - cross.T @ here.factor.solved(cross)
    normal[np.diag_indices(len(normal))] += prior_precision()[problem.free]
    return NormalEquations(Sensitivity(here.traced.parameters, columns), normal, _gradient(problem, here, columns))


def linear_response(problem: Problem, here: LinearSolution, columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Coefficients of background and floor that make up best for changes of the grey values, shape (N, P).

    The result has shape (M + D, P).
    """
    return here.factor.solved(_right_sides(_columns(problem, here.visible), columns))


def with_gradient_at(problem: Problem, here: LinearSolution, known: NormalEquations) -> NormalEquations:
    """The same equations a small way on, where only the gradient is another."""
    return replace(known, gradient=_gradient(problem, here, known.moves.of_pixels))


def _gradient(problem: Problem, here: LinearSolution, columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Half of the cost's fall by the free parameters, shape (P,).

    The linear ones may be held: at their optimum the cost does not change with them.
    """
    excess = (here.traced.parameters - prior_mean())[problem.free]
    return np.asarray((problem.weight * here.residual) @ columns - prior_precision()[problem.free] * excess)


@dataclass(frozen=True, slots=True, eq=False)
class NoiseModel:
    """Residuals of a fit as noise.

    Attributes
    ----------
    variance
        Per compared pixel, shape (N,).
    brightness
        From metal (0) to background (1) on the whole rectangle, shape (rows, columns).
    dark, bright
        Correlation of the standardised residuals between pixels of either kind.
    inflation
        Of the pixels' variance, by their brightness, shape (N,).
    """

    variance: NDArray[np.float64]
    brightness: NDArray[np.float64]
    dark: NoiseCorrelation
    bright: NoiseCorrelation
    inflation: NDArray[np.float64]


def problem_for(model: ForwardModel, detail: Detail, free: NDArray[np.bool_]) -> Problem:
    """Least-squares problem with the same weight for all pixels."""
    region = model.region
    field = spline_field(region.along_mm, region.across_mm, detail.knots_mm)
    weight = np.full(len(region.compared), _ASSUMED_NOISE**-2)
    return Problem(model, field, model.grey, _floor_basis(region), weight, detail.texture**-2, free)


def estimate_noise(problem: Problem, linear: LinearSolution) -> NoiseModel:
    """Variance and correlation of the residuals."""
    residual = linear.residual
    region = problem.model.region
    variance = variance_by_brightness(residual, problem.grey - residual)
    standardised = np.clip(residual / np.sqrt(variance), -_CLIPPED_DEVIATIONS, _CLIPPED_DEVIATIONS)
    brightness = np.clip(blurred_image(linear.traced.transmission, _BRIGHTNESS_BLUR_PX), 0.0, 1.0)
    here = brightness.ravel()[region.compared]

    def of_kind(kind: NDArray[np.bool_]) -> NoiseCorrelation:
        enough = kind if np.count_nonzero(kind) >= _LEAST_OF_A_KIND else np.ones_like(kind)
        return noise_correlation(standardised[enough], region.compared[enough], region.shape)

    dark, bright = mapped(of_kind, (here < 0.5, here >= 0.5), 2)
    inflation = (1.0 - here) * dark.inflation + here * bright.inflation
    return NoiseModel(variance, brightness, dark, bright, inflation)


def reweighted(problem: Problem, linear: LinearSolution, noise: NoiseModel) -> Problem:
    """The same problem with every pixel weighed by its variance, outliers less.

    Divided by the inflation, the cost counts independent samples: only then do priors have their due weight.
    """
    weight = robust_weight(linear.residual, noise.variance) / noise.inflation
    return replace(problem, weight=weight)


def evenly_weighted(problem: Problem, noise: NoiseModel) -> Problem:
    """The same problem with every pixel weighed by its variance, outliers as all others."""
    return replace(problem, weight=1.0 / (noise.variance * noise.inflation))


def whitened(problem: Problem, linear: LinearSolution, noise: NoiseModel) -> tuple[Problem, LinearSolution]:
    """The same problem on the image after the filter that makes its noise about independent, weights renewed.

    Also its solution, found with the old weights.
    """
    whitening = whitening_filter(noise.dark, noise.bright, noise.brightness)
    model = replace(problem.model, whitening=whitening)
    filtered = replace(problem, model=model, grey=model.grey)
    after = linear_solution_for(filtered, linear.traced)
    return reweighted(filtered, after, estimate_noise(filtered, after)), after


def _floor_basis(region: FitRegion) -> NDArray[np.float64]:
    """Grey value behind closed metal: scatter and glare vary slowly, like a quadratic in the strip, shape (N, 6)."""
    x, y = region.along_mm / 20.0, region.across_mm / 6.0
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """End of a fit: linear solution there; derivatives and projected normal matrix from where they were last taken.

    Most fits are steps on the way to another, and nobody asks for their derivatives: `with_derivatives` has them taken
    at the end where the last ones were too far away.

    `cost` is the sum of weighted squared residuals and priors (twice the negative logarithm of the likelihood, for
    independent pixels). `least_cost` is the same, but for a fit that was given up: what its end can hardly fall below.
    """

    linear: LinearSolution
    moves: Sensitivity
    normal_matrix: NDArray[np.float64]
    steps: int
    converged: bool
    least_cost: float

    @property
    def parameters(self) -> NDArray[np.float64]:
        """Where the fit ended, shape (PARAMETER_COUNT,)."""
        return self.linear.traced.parameters

    @property
    def cost(self) -> float:
        """Twice the negative logarithm of the posterior, up to a constant."""
        return self.linear.cost


def minimise(
    problem: Problem, start: NDArray[np.float64], most_steps: int, tolerance: float, cost_limit: float = np.inf
) -> Solution:
    """Levenberg-Marquardt on the free parameters until a step lowers the cost by less than `tolerance`.

    Stopped early when its end can hardly cost less than `cost_limit`.
    """
    return _levenberg_marquardt(problem, linear_solution_at(problem, start), most_steps, tolerance, cost_limit)


def minimise_from(problem: Problem, known: LinearSolution, most_steps: int, tolerance: float) -> Solution:
    """The same from where this or another problem in the same scene has been solved."""
    return _levenberg_marquardt(problem, linear_solution_from(problem, known), most_steps, tolerance, np.inf)


def _levenberg_marquardt(
    problem: Problem, here: LinearSolution, most_steps: int, tolerance: float, cost_limit: float
) -> Solution:
    damping, converged, steps = _LEAST_DAMPING, False, 0
    equations = normal_equations_at(problem, here)
    while steps < most_steps and not converged:
        least_cost = (
            here.cost - _TRUSTED_DECREASES * _predicted_decrease(equations) if here.cost > cost_limit else here.cost
        )
        if least_cost > cost_limit:
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
    equations = normal_equations_at(problem, solution.linear)
    return replace(solution, moves=equations.moves, normal_matrix=equations.normal_matrix)


def _equations_beside(problem: Problem, here: LinearSolution, known: NormalEquations) -> NormalEquations:
    """The equations after a step from where they are known."""
    if _is_close(problem, here, known.moves.at, known.normal_matrix):
        return with_gradient_at(problem, here, known)
    return normal_equations_at(problem, here)


def _predicted_decrease(equations: NormalEquations) -> float:
    """By how much the cost would fall if the model were as linear as it looks from here."""
    return float(equations.gradient @ np.linalg.lstsq(equations.normal_matrix, equations.gradient)[0])


def _step_down(
    problem: Problem,
    here: LinearSolution,
    equations: NormalEquations,
    damping: float,
    tolerance: float,
) -> tuple[LinearSolution | None, float]:
    """Solution after a step that lowers the cost (None when none does by enough), and the damping for the next."""
    normal, gradient = equations.normal_matrix, equations.gradient
    scale = np.diag(np.maximum(np.diag(normal), _LEAST_CURVATURE))
    least_decrease = _HOPELESS * tolerance
    while damping <= _MOST_DAMPING:
        step = np.linalg.solve(normal + damping * scale, gradient)
        if float(2.0 * gradient @ step - step @ normal @ step) < least_decrease:
            break
        trial = here.traced.parameters.copy()
        trial[problem.free] += step
        below = linear_solution_at(problem, clipped_to_bounds(trial))
        if below.cost < here.cost:
            return below, max(damping / _DAMPING_FACTOR, _LEAST_DAMPING)
        damping = max(damping * _DAMPING_FACTOR, _DAMPING_AFTER_FAILURE)
        # after a broken promise, a step that promises less than the tolerance would end the fit: it is saved
        least_decrease = tolerance
    return None, damping


def _is_close(
    problem: Problem, here: LinearSolution, at: NDArray[np.float64], normal_matrix: NDArray[np.float64]
) -> bool:
    """Whether derivatives taken elsewhere will do: fewer standard deviations away than change an edge's profile.

    Where the chamfer ends they change at once.
    """
    if has_chamfer(problem.model, here.traced.parameters) != has_chamfer(problem.model, at):
        return False
    way = (here.traced.parameters - at)[problem.free]
    return float(way @ normal_matrix @ way) < _CLOSE_DEVIATIONS**2
