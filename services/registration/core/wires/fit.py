"""Fit one K-wire's axis, in the guide's frame, to its outlines in one image or more.

Besides the wire's own unknowns (`WireModel`), every image has an error of the wire's apparent radius and one of the
guide's pose, each with its prior. What the images do not show stays as uncertain as its prior: one oblique image leaves
the axis free within a plane, and the covariance says so. The nail's place is carried along: its errors and the guide's
belong together (`SetUp`), so that a wire that tells of the guide tells of the nail too.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.wires import WIRE_DARKNESS, WIRE_SEEN, WIRE_SHARE
from services.registration.core.drill_clearance import across_basis
from services.registration.core.wires.image import PreparedView
from services.registration.core.wires.model import SHARED, START, TIP, Passage, WireModel, endings, wire_model
from services.registration.core.wires.outline import (
    PER_VIEW,
    EdgeMatches,
    Shape,
    match_edges,
    search_starts,
    shape_of,
    stacks_of,
)
from shared.errors import Reason
from shared.geometry.frames import Guide, Nail
from shared.geometry.lines import Line, read_only, unit
from shared.geometry.parts import GuidePart, Hole, NailPart, hole_surface_points
from shared.geometry.transform import Transform

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


# The outline is read at neighbouring points, whose errors go together: likelihoods of rivals count with this share.
_SAME_MM, _TEMPER = 0.15, 0.7
# A wire yields by so much to pass a hole that it would not quite meet.
_GIVES_MM = 0.3
_REACHES_PX = (6.0, 6.0, 5.0, 4.0, 3.0, 3.0, 2.5, 2.5, 2.5, 2.5)
_SCAN_SIGMAS = np.linspace(-2.5, 2.5, 21)
_NAIL = np.arange(-NAIL_SIZE, 0)
# What a fit tells of: the wire's four offsets, and the nail.
_TOLD = np.concatenate([np.arange(4), _NAIL])


@dataclass(frozen=True, slots=True, eq=False)
class WireFit:
    """A wire's axis as the images show it.

    Attributes
    ----------
    line_guide
        In the guide's frame, directed along drilling.
    offsets_mm
        Offsets across the guide hole's axis at the guide and at the nail (see `WireModel`), shape (4,).
    ends_mm, ends_sd_mm
        Where the wire begins and ends along the guide hole's axis, and how sure that is, shape (2,).
    nail_motion
        What the wire makes of the nail's place: a small motion of the nail in its own frame, shape (6,).
    covariance
        Of the offsets (mm) and the motion (rad, mm) together, shape (10, 10).
    seen_px, free_px
        Length of outline that was found in each image, and that is not hidden there, in pixels.
    darkness
        How dark the wire is between the nail's metal (1) and what lies beside the wire (0), median over all images, of
        points counted by their shares.
    """

    model: WireModel
    line_guide: Line
    offsets_mm: NDArray[np.float64]
    ends_mm: NDArray[np.float64]
    ends_sd_mm: NDArray[np.float64]
    nail_motion: NDArray[np.float64]
    covariance: NDArray[np.float64]
    seen_px: tuple[float, ...]
    free_px: tuple[float, ...]
    darkness: float


@dataclass(frozen=True, slots=True, eq=False)
class _Solution:
    model: WireModel
    state: NDArray[np.float64]
    system: System
    log_likelihood: float

    @property
    def seen_share(self) -> float:
        """Share of the outline that was found, in the image where it is least."""
        parts = [(rows.seen_px, rows.free_px) for rows in self.system.rows]
        return seen_share([seen for seen, _ in parts], [free for _, free in parts])

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Of offsets and nail, with what the outline says counted less when it fits worse than expected."""
        observed = (self.system.normal - self.system.prior) / max(1.0, self.system.mean_square)
        inverse = np.linalg.inv(self.system.prior + observed)
        return np.asarray(inverse[np.ix_(_TOLD, _TOLD)], dtype=np.float64)


def fit_wire(views: tuple[PreparedView, ...], models: tuple[WireModel, ...], known: NDArray[np.float64]) -> WireFit:
    """Find a wire near its guide hole's axis and fit it in all views together.

    Axes on a grid of places at the nail (8 mm about the guide's axis) are ranked by how much outline lies on edges.
    The best ones are moved by Gauss-Newton steps, with Cauchy weights, to where the outline's points meet edges, and
    the one that then explains the images best is taken. Others that explain them nearly as well (a wire seen nearly end
    on looks much the same from its other end; a wire may have passed the nail or not) widen the covariance by their
    distance, as likely as they are.

    Every image that should show the wire must show it: solutions that one image contradicts do not count if there is
    another. Whether what was found is a wire is for the caller to judge, by how much of its outline was seen.

    Parameters
    ----------
    models
        Of the same wire, equally likely before the images are seen; at least one whose wire may be anywhere.
    known
        Covariance of guide and nail, as `SetUp.covariance`, shape (6 V + 6, 6 V + 6).
    """
    precision = np.asarray(np.linalg.inv(known), dtype=np.float64)
    refined = [_refined(views, model, precision, start) for model in models for start in search_starts(views, model)]
    found = [s for s in refined if s.state[START] <= s.model.latest_start_mm] or refined
    solutions = _uncontradicted(found) or _uncontradicted(_along_the_weak(views, precision, found)) or found
    best = max(solutions, key=lambda solution: solution.log_likelihood)
    covariance, total = np.zeros((len(_TOLD), len(_TOLD))), 0.0
    for solution in _distinct(solutions, best):
        weight = float(np.exp(_TEMPER * (solution.log_likelihood - best.log_likelihood)))
        apart = (solution.state - best.state)[_TOLD]
        covariance += weight * (solution.covariance + np.outer(apart, apart))
        total += weight
    return WireFit(
        best.model,
        best.model.line_guide(best.state[:4]),
        read_only(best.state[:4]),
        read_only(best.state[[START, TIP]]),
        read_only(np.sqrt(np.diag(np.linalg.inv(best.system.normal))[[START, TIP]])),
        read_only(best.state[_NAIL]),
        read_only(covariance / total),
        tuple(rows.seen_px for rows in best.system.rows),
        tuple(rows.free_px for rows in best.system.rows),
        _darkness(best.system.rows),
    )


def _darkness(views: tuple[Rows, ...]) -> float:
    """Median over the outlines' points, each counted by its share; 0 when there is none."""
    darkness = np.concatenate([rows.matches.darkness for rows in views])
    share = np.concatenate([rows.matches.share for rows in views])
    order = np.argsort(darkness)
    up_to = np.cumsum(share[order])
    return float(darkness[order][np.searchsorted(up_to, 0.5 * up_to[-1])]) if len(order) else 0.0


def seen_share(seen_px: Sequence[float], free_px: Sequence[float]) -> float:
    """Least share of the outline that was found in any image in which enough of it could be seen; 0 when in none."""
    shares = [seen / free for seen, free in zip(seen_px, free_px, strict=True) if WIRE_SEEN.is_met(free)]
    return min(shares, default=0.0)


def _uncontradicted(solutions: list[_Solution]) -> list[_Solution]:
    return [solution for solution in solutions if WIRE_SHARE.is_met(solution.seen_share)]


def _along_the_weak(
    views: tuple[PreparedView, ...], precision: NDArray[np.float64], found: list[_Solution]
) -> list[_Solution]:
    """The best solution moved along what is least certain: where an image that should show the wire may hide it."""
    best = max(found, key=lambda solution: solution.log_likelihood)
    covariance = np.linalg.inv(best.system.normal)
    values, vectors = np.linalg.eigh(covariance[:4, :4])
    one_sigma = covariance[:, :4] @ vectors[:, -1] / np.sqrt(values[-1])
    return [_judged(views, best.model, precision, best.state + sigmas * one_sigma) for sigmas in _SCAN_SIGMAS]


def _distinct(solutions: list[_Solution], best: _Solution) -> list[_Solution]:
    """The best solution and those that differ from it and from one another by more than the fit's own rest."""
    chosen = [best]
    for solution in sorted(solutions, key=lambda s: -s.log_likelihood):
        if all(float(np.abs((solution.state - other.state)[:4]).max()) > _SAME_MM for other in chosen):
            chosen.append(solution)
    return chosen


def _refined(
    views: tuple[PreparedView, ...], model: WireModel, precision: NDArray[np.float64], start: NDArray[np.float64]
) -> _Solution:
    state = np.concatenate([start, np.zeros(PER_VIEW * len(views) + NAIL_SIZE)])
    for reach_px in _REACHES_PX:
        system = linearised(views, model, precision, state, reach_px)
        state = state + np.linalg.solve(system.normal, system.gradient)
    return _judged(views, model, precision, state)


def _judged(
    views: tuple[PreparedView, ...], model: WireModel, precision: NDArray[np.float64], state: NDArray[np.float64]
) -> _Solution:
    system = linearised(views, model, precision, state, _REACHES_PX[-1])
    deviation = state[:SHARED] - model.mean
    prior = -0.5 * float(deviation @ model.precision @ deviation) - float(np.log(model.ending.sd_mm))
    seen = sum(rows.log_likelihood for rows in system.rows)
    solution = _Solution(model, state, system, prior + seen)
    return replace(solution, log_likelihood=solution.log_likelihood - _impossibility(solution))


def _impossibility(solution: _Solution) -> float:
    """By how much a wire that is taken to have passed the nail is less likely for where it meets the nail."""
    passage = solution.model.ending.passage
    if passage is None:
        return 0.0
    missed_mm = max(passage.missed_by_mm(solution.state[2:4]) - _GIVES_MM, 0.0)
    variance_mm2 = float(np.linalg.eigvalsh(solution.covariance[2:4, 2:4])[-1])
    return 0.5 * missed_mm**2 / variance_mm2


WIRE_DIAMETER_MM = 2.0


def find_wire(
    views: tuple[PreparedView, ...],
    guide: GuidePart,
    guide_hole: Hole,
    nail: NailPart,
    guide_from_nail: Transform[Guide, Nail],
    known: NDArray[np.float64],
) -> WireFit | Reason:
    """The wire through one guide hole, or why there is none to be seen.

    Parameters
    ----------
    guide_hole
        The nail has one of the same id.
    known
        Covariance of guide and nail, as `SetUp.covariance`.
    """
    nail_hole = next(hole for hole in nail.holes if hole.id == guide_hole.id)
    entry_mm = guide_from_nail @ hole_surface_points(nail, nail_hole)[0]
    along_mm = float((entry_mm - guide_hole.axis.point_mm) @ guide_hole.axis.direction)
    ways = endings(_passage(guide_hole, nail, nail_hole, entry_mm, guide_from_nail))
    models = tuple(wire_model(guide, guide_hole, WIRE_DIAMETER_MM, along_mm, ending) for ending in ways)
    fit = fit_wire(views, models, known)
    seen = sum(fit.seen_px)
    fraction = seen_share(fit.seen_px, fit.free_px)
    if WIRE_SEEN.is_met(seen) and WIRE_SHARE.is_met(fraction) and WIRE_DARKNESS.is_met(fit.darkness):
        return fit
    return WIRE_SEEN.reason(
        f"no wire was found through guide hole '{guide_hole.id}': {WIRE_SEEN.quoted(seen)} of its outline are visible, "
        f"{WIRE_SHARE.quoted(fraction)} of what is not hidden, and it is "
        f"{WIRE_DARKNESS.quoted(max(fit.darkness, 0.0))} as dark as the nail"
    )


def _passage(
    guide_hole: Hole,
    nail: NailPart,
    nail_hole: Hole,
    entry_guide_mm: NDArray[np.float64],
    guide_from_nail: Transform[Guide, Nail],
) -> Passage:
    across = across_basis(guide_hole.axis.direction)
    beside = across @ np.cross(guide_hole.axis.direction, guide_from_nail.directions(np.array([1.0, 0.0, 0.0])))
    return Passage(
        read_only(across @ (entry_guide_mm - guide_hole.axis.point_mm)),
        0.5 * (nail_hole.diameter_mm - WIRE_DIAMETER_MM),
        read_only(unit(beside)),
        nail.radius_mm + 0.5 * WIRE_DIAMETER_MM,
    )
