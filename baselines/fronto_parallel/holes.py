"""The paper's search for the nail's holes: a window as wide as the nail moves along it and counts edge elements.

"The algorithm finds the two locations containing the maximal number of edge elements. It then fits an ellipse to the
edge elements at these locations." The nail's file says how far apart the holes are: the locations are those of the
whole pattern, for any number of holes. Elements much weaker than those of the nail's own edges are noise and do not
count. The ellipse takes those whose far side from its middle is darker, for an opening is brighter than the metal about
it; elements that it does not explain are left out in turn.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baselines.fronto_parallel.band import Band
from baselines.fronto_parallel.edges import EdgeImage
from services.registration.core.nail.search.outline import Ellipse, fit_ellipse
from shared.geometry.parts import NailPart

_INSIDE_SHARE = 0.42
_ON_LINE_PX, _LEAST_STRENGTH = 1.5, 0.35
_SCALES = np.linspace(0.96, 1.06, 6)
_FACING = 0.5
_WINDOW_SHARE = 0.62
_FIT_ROUNDS = 6
_LEAST_ELEMENTS = 14
_TOLERANCE_PX = (3.0, 2.0, 1.5, 1.2, 1.0, 1.0)
_LEAST_SEEN = 0.3


@dataclass(frozen=True, slots=True, eq=False)
class SeenHole:
    """The opening of one hole: its ellipse in ideal pixels, and over which part of its length edges were found."""

    hole_id: str
    ellipse: Ellipse
    seen_fraction: float


@dataclass(frozen=True, slots=True, eq=False)
class _Pattern:
    """Where the holes are thought to be: place along the band (px), in the order of the nail's file, shape (N,)."""

    along_px: NDArray[np.float64]
    elements: int


def find_holes(image: EdgeImage, band: Band, nail: NailPart, distal: NDArray[np.float64]) -> list[SeenHole | None]:
    """Openings of the holes in the order of the nail's file; None for one whose outline can hardly be seen.

    Parameters
    ----------
    distal
        Rough direction of the nail's +x in the image, shape (2,).
    """
    sign = 1.0 if float(band.along @ distal) >= 0.0 else -1.0
    offset = image.place_px @ band.across - band.middle_px
    along = image.place_px @ band.along
    seen = (along > band.reach_px[0]) & (along < band.reach_px[1])
    on_lines = seen & (np.abs(np.abs(offset) - 0.5 * band.width_px) < _ON_LINE_PX)
    if not on_lines.any():
        return [None] * len(nail.holes)
    strong = image.strength > _LEAST_STRENGTH * float(np.median(image.strength[on_lines]))
    inside = seen & strong & (np.abs(offset) < _INSIDE_SHARE * band.width_px)
    place, outward = image.place_px[inside], image.outward[inside]
    if not len(place):
        return [None] * len(nail.holes)
    px_per_mm = band.width_px / nail.diameter_mm
    pattern = _most_elements(place @ band.along, band, sign * px_per_mm, nail)
    found: list[SeenHole | None] = []
    for hole, along_px in zip(nail.holes, pattern.along_px, strict=True):
        middle = band.along * along_px + band.across * band.middle_px
        found.append(_opening(place, outward, middle, hole.id, 0.5 * hole.diameter_mm * px_per_mm))
    return found


def _most_elements(along_px: NDArray[np.float64], band: Band, signed_px_per_mm: float, nail: NailPart) -> _Pattern:
    """Place of the pattern whose windows, as long as the nail is wide, hold most edge elements."""
    first = float(along_px.min())
    counts = np.bincount((along_px - first).astype(np.int64)).astype(np.float64)
    half = int(0.5 * band.width_px)
    padded = np.pad(counts, 2 * half + 1)
    totals = np.concatenate([[0.0], np.cumsum(padded)])
    # an opening fits into the window at many places: elements near its middle line decide among them
    window = totals[2 * half + 1 :] - totals[: -(2 * half + 1)]
    window = np.convolve(window, np.ones(2 * half + 1) / (2 * half + 1), mode="same")
    start = first - half - 1
    hole_x_mm = np.array([float(hole.axis.point_mm[0]) for hole in nail.holes])
    best = _Pattern(np.zeros(len(hole_x_mm)), -1)
    for scale in _SCALES:
        ahead = np.rint(hole_x_mm * signed_px_per_mm * scale).astype(np.int64)
        places = np.arange(max(0, -int(ahead.min())), len(window) - max(0, int(ahead.max())))
        if not len(places):
            continue
        held = window[places[:, None] + ahead]
        # the emptiest window decides first: one rich place must not stand for two
        score = held.sum(axis=1) + len(ahead) * held.min(axis=1)
        k = int(np.argmax(score))
        if score[k] > best.elements:
            best = _Pattern(start + places[k] + ahead.astype(np.float64), int(score[k]))
    return best


def _opening(
    place_px: NDArray[np.float64],
    outward: NDArray[np.float64],
    middle_px: NDArray[np.float64],
    hole_id: str,
    radius_px: float,
) -> SeenHole | None:
    """Ellipse through the elements in the window that face its middle; the middle is then taken from it."""
    ellipse: Ellipse | None = None
    used = np.zeros(0, dtype=np.float64)
    for tolerance in _TOLERANCE_PX[:_FIT_ROUNDS]:
        centre = middle_px if ellipse is None else ellipse.centre_px
        from_centre = place_px - centre
        distance = np.maximum(np.hypot(*from_centre.T), 1e-9)
        facing = -np.sum(from_centre * outward, axis=1) / distance > _FACING
        near = facing & (distance < _WINDOW_SHARE / 0.5 * radius_px) & (distance > 0.35 * radius_px)
        if ellipse is not None:
            near &= np.abs(ellipse.signed_distance_px(place_px)) < tolerance
        if np.count_nonzero(near) < _LEAST_ELEMENTS:
            return None
        ellipse = fit_ellipse(place_px[near])
        if ellipse is None or not 0.5 * radius_px < ellipse.semi_axes_px[0] < 1.4 * radius_px:
            return None
        used = np.unique(np.floor(np.degrees(np.arctan2(*(place_px[near] - ellipse.centre_px).T[::-1])) / 10.0))
    seen = len(used) / 36.0
    return None if ellipse is None or seen < _LEAST_SEEN else SeenHole(hole_id, ellipse, seen)
