"""Normal equations of a wire's fit: how its outline in each image moves with the unknowns, and what is known before."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.wires.model import SHARED, START, TIP, WireModel
from services.registration.core.wires.outline import EdgeMatches, match_edges
from services.registration.core.wires.shape import PER_VIEW, Shape, shape_of, stacks_of
from services.registration.core.wires.view import PreparedView

NAIL_SIZE = 6
_RADIUS_SD_PX = 0.3
_EDGE_SD_PX, _EDGE_CORRELATION_PX = 0.35, 4.0
_ROBUST_PX = 1.2
_SEEN_NATS, _MISSING_NATS, _TYPICAL_SHIFT_PX = 2.0, -1.3, 0.5
_SEEN_WITHIN_PX = 1.0
_STEPS = np.array([1e-3] * (SHARED + 1) + [1e-5] * 3 + [1e-3] * 3)


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Linearised observations of one view: derivatives along the normals, shifts, weights, effective number."""

    shape: Shape
    matches: EdgeMatches
    derivative: NDArray[np.float64]
    weight: NDArray[np.float64]
    effective_count: float

    @property
    def free_px(self) -> float:
        """Length of outline that is not hidden."""
        return float(self.shape.free_px.sum())

    @property
    def seen_px(self) -> float:
        """Length of it that was found."""
        close = self.matches.share * (np.abs(self.matches.shift_px) < _SEEN_WITHIN_PX)
        return float(close @ self.shape.free_px[self.matches.index])

    @property
    def log_likelihood(self) -> float:
        """How well edges lie on the outline: a long-tailed law for each correlation length, and a price for none."""
        seen_nats = _SEEN_NATS - np.log1p((self.matches.shift_px / _TYPICAL_SHIFT_PX) ** 2)
        nats = np.full(len(self.shape.free), _MISSING_NATS)
        nats[self.matches.index] += self.matches.share * (seen_nats - _MISSING_NATS)
        return float(nats @ self.shape.free_px) / _EDGE_CORRELATION_PX


@dataclass(frozen=True, slots=True, eq=False)
class System:
    """Normal equations at a state: of the priors alone, and of everything; the gradient; how well the outlines fit."""

    prior: NDArray[np.float64]
    normal: NDArray[np.float64]
    gradient: NDArray[np.float64]
    mean_square: float
    rows: tuple[Rows, ...]


def linearised(
    views: tuple[PreparedView, ...],
    model: WireModel,
    precision: NDArray[np.float64],
    state: NDArray[np.float64],
    reach_px: float,
) -> System:
    """Normal equations of all views and priors at a state: wire, then radius and guide of each view, then the nail."""
    prior = _prior(model, precision, len(views))
    mean = np.concatenate([model.mean, np.zeros(state.size - SHARED)])
    normal, gradient = prior.copy(), prior @ (mean - state)
    all_rows = []
    for k, view in enumerate(views):
        columns = np.concatenate([np.arange(SHARED), SHARED + k * PER_VIEW + np.arange(PER_VIEW)])
        rows = _rows(view, model, state[columns], reach_px)
        weighted = rows.weight[:, None] * rows.derivative
        normal[np.ix_(columns, columns)] += weighted.T @ rows.derivative
        gradient[columns] += weighted.T @ rows.matches.shift_px
        all_rows.append(rows)
    squares = sum(float(rows.weight @ rows.matches.shift_px**2) for rows in all_rows)
    count = sum(rows.effective_count for rows in all_rows)
    return System(prior, normal, gradient, squares / max(count, 1.0), tuple(all_rows))


def _prior(model: WireModel, precision: NDArray[np.float64], view_count: int) -> NDArray[np.float64]:
    """Precision of all unknowns before the wire is looked at."""
    size = SHARED + PER_VIEW * view_count + NAIL_SIZE
    prior = np.zeros((size, size))
    prior[:SHARED, :SHARED] = model.precision
    radius = SHARED + PER_VIEW * np.arange(view_count)
    prior[radius, radius] = _RADIUS_SD_PX**-2
    others = np.setdiff1d(np.arange(SHARED, size), radius)
    prior[np.ix_(others, others)] = precision
    return prior


def _rows(view: PreparedView, model: WireModel, unknowns: NDArray[np.float64], reach_px: float) -> Rows:
    shape = shape_of(view, model, unknowns)
    matches = match_edges(view, shape.stack, shape.outline, reach_px)
    disc, outward = shape.outline.disc[matches.index], shape.outline.outward[matches.index]
    moved = stacks_of(view, model, unknowns + np.diag(_STEPS), len(shape.stack.radius_px))
    by_centre = (moved.centre_px - shape.stack.centre_px)[:, disc]
    derivative = np.einsum("jmi,mi->mj", by_centre, outward) / _STEPS
    # A change of apparent radius along the wire is left to the view's own radius error: edges shift with contrast.
    ends = [START, TIP, SHARED]
    derivative[:, ends] += ((moved.radius_px[ends] - shape.stack.radius_px) / _STEPS[ends, None])[:, disc].T
    crowding = np.maximum(_EDGE_CORRELATION_PX / np.maximum(shape.outline.length_px[matches.index], 1e-6), 1.0)
    effective = matches.share / crowding
    weight = effective / (_EDGE_SD_PX**2 * (1.0 + (matches.shift_px / _ROBUST_PX) ** 2))
    return Rows(shape, matches, derivative, weight, float(effective.sum()))
