"""Where to begin fitting a wire: axes on a grid, ranked by how much of their outline lies on edges."""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.wires.model import WireModel
from services.registration.core.wires.outline import Stack, match_edges
from services.registration.core.wires.shape import PER_VIEW, shape_in, stacks_of
from services.registration.core.wires.view import PreparedView

_SEARCH_REACH_MM, _SEARCH_STEP_MM, _SEARCH_REACH_PX = 8.0, 0.8, 3.0
_OTHER_TIPS_MM = (-10.0, 10.0)
_SEARCH_DISCS = 40
_CANDIDATES, _STARTS, _STARTS_APART_MM = 40, 5, 1.0
_PENALTY_OF_MISSING = 0.5


def search_starts(views: tuple[PreparedView, ...], model: WireModel) -> list[NDArray[np.float64]]:
    """Best axes of a grid through the middle of the guide hole, apart from one another, for a few places of the tip."""
    steps = np.arange(-_SEARCH_REACH_MM, _SEARCH_REACH_MM + 1e-9, _SEARCH_STEP_MM)
    scored = _ranked(views, model, [(x, y, 0.0) for x in steps for y in steps])[:_CANDIDATES]
    others = [(x, y, tip) for _, (x, y, _) in scored for tip in _OTHER_TIPS_MM]
    chosen: list[tuple[float, float, float]] = []
    for _, place in sorted(scored + _ranked(views, model, others), reverse=True):
        if all(np.hypot(place[0] - x, place[1] - y) > _STARTS_APART_MM for x, y, _ in chosen):
            chosen.append(place)
    return [_unknowns_at(model, place) for place in chosen[:_STARTS]]


def _ranked(
    views: tuple[PreparedView, ...], model: WireModel, places: list[tuple[float, float, float]]
) -> list[tuple[float, tuple[float, float, float]]]:
    """Scores of places at the nail (two offsets, and how far the tip is past its usual place, in mm), best first."""
    unknowns = np.array([_unknowns_at(model, place) for place in places])
    deviation = unknowns - model.mean
    scores = -0.5 * np.einsum("bi,ij,bj->b", deviation, model.precision, deviation)
    in_view = np.concatenate([unknowns, np.zeros((len(places), PER_VIEW))], axis=1)
    for view in views:
        stacks = stacks_of(view, model, in_view, _SEARCH_DISCS)
        pairs = zip(stacks.centre_px, stacks.radius_px, strict=True)
        scores += [_evidence_px(view, Stack(centre_px, radius_px)) for centre_px, radius_px in pairs]
    return sorted(zip(scores.tolist(), places, strict=True), reverse=True)


def _unknowns_at(model: WireModel, place: tuple[float, float, float]) -> NDArray[np.float64]:
    return np.asarray(model.mean + np.array([0.0, 0.0, place[0], place[1], 0.0, place[2]]))


def _evidence_px(view: PreparedView, stack: Stack) -> float:
    shape = shape_in(view, stack)
    matches = match_edges(view, shape.stack, shape.outline, _SEARCH_REACH_PX)
    seen_px = float(matches.share @ shape.free_px[matches.index])
    return seen_px - _PENALTY_OF_MISSING * float(shape.free_px.sum())
