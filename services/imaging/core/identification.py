"""Identify the ring's balls among the discs of an image: any rotation, mirrored or not, with others and gaps.

Pairs of discs are matched with pairs of balls of one plate. Each such hypothesis is scored in its neighbourhood, where
distortion is little more than a similarity. The best ones are grown outwards while a polynomial learns the distortion;
the one that explains most balls is accepted, and the second-best different one gives the margin.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from services.imaging.core.nominal import NominalGeometry
from services.imaging.core.similarity_hypotheses import Array, Hypotheses, Ints, similarity_hypotheses
from services.imaging.core.tuning import IDENTIFICATION
from shared.geometry.calibration import BallCandidates
from shared.geometry.parts import RingPart
from shared.xray.assignment import nearest_to_each
from shared.xray.pixel_scale import pixels

_NONE = -1


@dataclass(frozen=True, slots=True, eq=False)
class RingIdentity:
    """Which candidate is which ball.

    Attributes
    ----------
    mirrored
        The image as given shows the ring mirrored.
    candidate_of_ball
        Index of the candidate of each ball of the ring, or -1, shape (M,).
    identified
        Number of balls with a candidate.
    runner_up
        The same number of the best different identity.
    """

    mirrored: bool
    candidate_of_ball: Ints
    identified: int
    runner_up: int


@dataclass(frozen=True, slots=True, eq=False)
class _Grown:
    mirrored: bool
    matches: Ints
    count: int


def identify_ring(candidates: BallCandidates, ring: RingPart, nominal: NominalGeometry) -> RingIdentity | None:
    """Find the ring's constellation among dark discs.

    Parameters
    ----------
    candidates
        Dark discs, the clearest first; many may belong to other things.
    ring
        The ring.
    nominal
        C-arm values, wrong by up to ten per cent.

    Returns
    -------
    RingIdentity or None
        The best identity and how many balls the second-best explains; None when no hypothesis explains eight balls.
    """
    if len(candidates.radius_px) < IDENTIFICATION.least_discs:
        return None
    constellation = Constellation.of(ring, nominal)
    hypotheses = similarity_hypotheses(
        candidates, constellation.flat_mm, constellation.plate, nominal.ring_scale_px_per_mm
    )
    matcher = _Matcher(candidates, constellation, nominal.pixel_mm)
    grown = [
        g for i in range(min(len(hypotheses), IDENTIFICATION.grown)) if (g := _grow(hypotheses, i, matcher)) is not None
    ]
    if not grown:
        return None
    best = max(grown, key=lambda g: g.count)
    different = [g.count for g in grown if not _same(g, best)]
    return RingIdentity(best.mirrored, best.matches, best.count, max(different, default=0))


@dataclass(frozen=True, slots=True, eq=False)
class Constellation:
    """The ring as a flat pattern: balls projected from the nominal source onto the plane z = 0.

    Attributes
    ----------
    flat_mm
        Shape (M, 2).
    height
        0 on the plane z = 0, 1 at the farthest ball, shape (M,).
    plate
        Number of the plate of each ball, shape (M,).
    radius_px
        Nominal radius of each shadow, shape (M,).
    """

    flat_mm: Array
    height: Array
    plate: Ints
    radius_px: Array

    @staticmethod
    def of(ring: RingPart, nominal: NominalGeometry) -> "Constellation":
        """From a ring and nominal C-arm values."""
        position = ring.balls.position_mm
        magnification = nominal.source_to_ring_mm / (nominal.source_to_ring_mm + position[:, 2])
        farthest = max(float(np.abs(position[:, 2]).max()), 1e-6)
        return Constellation(
            flat_mm=position[:, :2] * magnification[:, None],
            height=np.abs(position[:, 2]) / farthest,
            plate=np.round(position[:, 2]).astype(np.int64),
            radius_px=0.5 * ring.balls.diameter_mm * magnification * nominal.ring_scale_px_per_mm,
        )


class _Matcher:
    """Nearest candidates of about the right size."""

    def __init__(self, candidates: BallCandidates, constellation: Constellation, pixel_mm: float) -> None:
        self.centre_px = candidates.centre_px
        self.constellation = constellation
        self.pixel_mm = pixel_mm
        self._radius = candidates.radius_px
        self._tree = cKDTree(candidates.centre_px)
        # of every order that a step may afford: all steps of all hypotheses use them
        flat_mm, height = constellation.flat_mm, constellation.height
        highest = max(step.order for step in IDENTIFICATION.steps)
        self.bases = {order: warp_basis(flat_mm, height, order) for order in range(1, highest + 1)}

    def match(self, predicted_px: Array, balls: Ints, reach_px: float) -> tuple[Ints, Ints]:
        """Pairs (ball, candidate), one to one."""
        distance, index = map(np.asarray, self._tree.query(predicted_px[balls], distance_upper_bound=reach_px))
        found = np.isfinite(distance)
        ball, candidate, distance = balls[found], index[found], distance[found]
        ratio = np.log(self._radius[candidate] / self.constellation.radius_px[ball])
        fits = (ratio > IDENTIFICATION.smallest_log_radius) & (ratio < IDENTIFICATION.largest_log_radius)
        ball, candidate, distance = ball[fits], candidate[fits], distance[fits]
        keep = nearest_to_each(candidate, distance)
        return ball[keep], candidate[keep]


def _grow(hypotheses: Hypotheses, index: int, matcher: _Matcher) -> _Grown | None:
    flat = matcher.constellation.flat_mm
    predicted = hypotheses.predict(index, flat)
    from_anchor = np.hypot(*(flat - flat[hypotheses.anchor[index]]).T)
    ball = candidate = np.zeros(0, dtype=np.int64)
    for step in IDENTIFICATION.steps:
        near = np.flatnonzero(from_anchor < step.radius_mm)
        ball, candidate = matcher.match(predicted, near, pixels(step.reach_detector_mm, matcher.pixel_mm))
        basis = matcher.bases[_affordable(step.order, len(ball))]
        if len(ball) < max(IDENTIFICATION.least_matches, basis.shape[1] + 1):
            return None
        coefficients, *_ = np.linalg.lstsq(basis[ball], matcher.centre_px[candidate], rcond=None)
        predicted = basis @ coefficients
    matches = np.full(len(flat), _NONE, dtype=np.int64)
    matches[ball] = candidate
    return _Grown(bool(hypotheses.mirrored[index]), matches, len(ball))


def _affordable(order: int, matches: int) -> int:
    """Highest order, up to `order`, that leaves at least as many matches over as it has coefficients."""
    while order > 1 and matches < (order + 1) * (order + 2):
        order -= 1
    return order


def warp_basis(flat_mm: Array, height: Array, order: int) -> Array:
    """Polynomial of the flat pattern plus what a shifted source does to balls above the plane, shape (M, terms)."""
    x, y = (flat_mm / 100.0).T
    terms = [x**i * y**j for i in range(order + 1) for j in range(order + 1 - i)]
    terms.append(height)
    if order > 1:
        terms += [height * x, height * y]
    return np.stack(terms, axis=1)


def _same(a: _Grown, b: _Grown) -> bool:
    """Whether two identities agree in most of the balls that both explain."""
    both = (a.matches != _NONE) & (b.matches != _NONE)
    agree = int(np.count_nonzero(a.matches[both] == b.matches[both]))
    return a.mirrored == b.mirrored and agree > 0.5 * min(a.count, b.count)
