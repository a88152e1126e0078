"""Similarities from the ring to the image: pairs of discs are matched with pairs of balls and scored."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from services.imaging.core.tuning import HYPOTHESIS_SEARCH
from shared.compiled import compiled
from shared.geometry.calibration import BallCandidates
from shared.two_cores import on_both_halves
from shared.xray.pixel_scale import pixels

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Complexes = NDArray[np.complex128]
Mask = NDArray[np.bool_]

# Fewer are scored sooner than handed to another core.
_LEAST_ON_TWO_CORES = 5000


@dataclass(frozen=True, slots=True, eq=False)
class Hypotheses:
    """Similarities from the flat ring to the image, best first, written as complex numbers.

    `pixel = factor * flat + offset`, with the flat pattern's y negated first where `mirrored`.

    Attributes
    ----------
    factor, offset
        Shape (S,).
    mirrored
        Shape (S,).
    anchor
        The ball from which the hypothesis was made, shape (S,): there it is most exact.
    """

    factor: Complexes
    offset: Complexes
    mirrored: Mask
    anchor: Ints

    def __len__(self) -> int:
        return len(self.factor)

    def select(self, which: Ints) -> "Hypotheses":
        """Those of an index array."""
        return Hypotheses(self.factor[which], self.offset[which], self.mirrored[which], self.anchor[which])

    def predict(self, index: int, flat_mm: Array) -> Array:
        """Pixels, shape (M, 2), of points of the flat pattern, shape (M, 2)."""
        z = _complex(flat_mm)
        z = np.conj(z) if self.mirrored[index] else z
        pixel = self.factor[index] * z + self.offset[index]
        return np.stack([pixel.real, pixel.imag], axis=1)


def _complex(points: Array) -> Complexes:
    return np.asarray(points[:, 0] + 1j * points[:, 1])


def similarity_hypotheses(
    candidates: BallCandidates, flat_mm: Array, plate: Ints, scale_px_per_mm: float
) -> Hypotheses:
    """Match pairs of discs with pairs of balls of one plate and score each hypothesis in its neighbourhood.

    Parameters
    ----------
    candidates
        Dark discs, the clearest first.
    flat_mm, plate
        The ring's flat pattern, shape (M, 2), and the plate of each ball, shape (M,).
    scale_px_per_mm
        Nominal scale.

    Returns
    -------
    Hypotheses
        Distinct hypotheses, best first.
    """
    discs = _complex(candidates.centre_px)
    balls = _complex(flat_mm)
    disc_pairs = _disc_pairs(candidates.centre_px[: HYPOTHESIS_SEARCH.clearest], scale_px_per_mm)
    ball_pairs = _ball_pairs(flat_mm, plate)
    parts = [
        _similarities(discs, disc_pairs, np.conj(balls) if mirrored else balls, ball_pairs, scale_px_per_mm)
        for mirrored in (False, True)
    ]
    factor, offset = (np.concatenate([p[i] for p in parts]) for i in range(2))
    pair = np.concatenate([p[2] for p in parts])
    mirrored = np.repeat([False, True], [len(p[0]) for p in parts])
    hypotheses = Hypotheses(factor, offset, mirrored, ball_pairs[pair, 0])
    reach_px = pixels(HYPOTHESIS_SEARCH.reach_detector_mm, 1.0 / scale_px_per_mm)
    return _distinct(_scored(hypotheses, candidates, flat_mm, reach_px), scale_px_per_mm)


def _disc_pairs(centre_px: Array, scale: float) -> Ints:
    """Pairs of neighbouring discs from all over the image, those of the clearest discs first, shape (P, 2)."""
    tree = cKDTree(centre_px)
    pairs = tree.query_pairs(HYPOTHESIS_SEARCH.longest_mm * scale, output_type="ndarray").astype(np.int64)
    length = np.hypot(*(centre_px[pairs[:, 0]] - centre_px[pairs[:, 1]]).T)
    pairs = pairs[length > HYPOTHESIS_SEARCH.shortest_mm * scale]
    order = np.argsort(pairs.max(axis=1), kind="stable")
    pairs = pairs[order]
    # Every disc in a few pairs only: a clear disc that is not of the ring must not use up all pairs.
    used = np.zeros(len(centre_px), dtype=np.int64)
    kept: list[int] = []
    for index, (a, b) in enumerate(pairs):
        if max(used[a], used[b]) < HYPOTHESIS_SEARCH.pairs_of_a_disc:
            used[a] += 1
            used[b] += 1
            kept.append(index)
        if len(kept) == HYPOTHESIS_SEARCH.image_pairs:
            break
    return np.asarray(pairs[kept])


def _ball_pairs(flat_mm: Array, plate: Ints) -> Ints:
    """Ordered pairs of balls of one plate, shape (Q, 2)."""
    tree = cKDTree(flat_mm)
    pairs = tree.query_pairs(
        HYPOTHESIS_SEARCH.longest_mm * (1.0 + HYPOTHESIS_SEARCH.scale_tolerance), output_type="ndarray"
    ).astype(np.int64)
    pairs = pairs[plate[pairs[:, 0]] == plate[pairs[:, 1]]]
    return np.concatenate([pairs, pairs[:, ::-1]])


def _similarities(
    discs: Complexes, disc_pairs: Ints, balls: Complexes, ball_pairs: Ints, scale: float
) -> tuple[Complexes, Complexes, Ints]:
    """Similarities of all pairs of pairs whose scale is about right: factor, offset and ball pair, shape (S,) each."""
    from_disc, to_disc = discs[disc_pairs].T
    from_ball, to_ball = balls[ball_pairs].T
    factor = (to_disc - from_disc)[:, None] / (to_ball - from_ball)[None]
    right = np.abs(np.log(np.abs(factor) / scale)) < HYPOTHESIS_SEARCH.scale_tolerance
    rows, columns = np.nonzero(right)
    chosen = factor[rows, columns]
    return chosen, from_disc[rows] - chosen * from_ball[columns], columns.astype(np.int64)


def _scored(hypotheses: Hypotheses, candidates: BallCandidates, flat_mm: Array, reach_px: float) -> Hypotheses:
    """Count discs near the balls that each hypothesis predicts; keep the best hypotheses, best first."""
    occupied, low_px = _occupied(candidates.centre_px, reach_px)
    balls, neighbours, offset = _complex(flat_mm), _neighbours(flat_mm), hypotheses.offset - complex(*low_px)

    def counted(part: slice) -> tuple[Ints, Ints]:
        of_part = hypotheses.factor[part], offset[part], hypotheses.mirrored[part], hypotheses.anchor[part]
        return _counted(*of_part, balls, neighbours, occupied)

    halves = on_both_halves(counted, len(hypotheses), _LEAST_ON_TWO_CORES)
    inside, hit = (np.concatenate(counts) for counts in zip(*halves, strict=True))
    score = (hit - float(occupied.mean()) * inside) / np.sqrt(np.maximum(inside, HYPOTHESIS_SEARCH.least_counted))
    return hypotheses.select(np.argsort(-score, kind="stable")[: HYPOTHESIS_SEARCH.kept])


@compiled
def _counted(
    factor: Complexes,
    offset: Complexes,
    mirrored: Mask,
    anchor: Ints,
    balls: Complexes,
    neighbours: Ints,
    occupied: Mask,
) -> tuple[Ints, Ints]:
    """How many balls around each hypothesis's anchor lie on the map, and how many of these on a disc, shape (S,) each.

    Offsets are from the map's corner. Compiled: with numpy, 100,000 hypotheses took most of identification's time.
    """
    rows, columns = occupied.shape
    inside, hit = np.zeros(len(factor), dtype=np.int64), np.zeros(len(factor), dtype=np.int64)
    for hypothesis in range(len(factor)):
        a, b = factor[hypothesis].real, factor[hypothesis].imag
        x0, y0, sign = offset[hypothesis].real, offset[hypothesis].imag, -1.0 if mirrored[hypothesis] else 1.0
        for ball in neighbours[anchor[hypothesis]]:
            if ball < 0:
                break
            x, y = balls[ball].real, sign * balls[ball].imag
            column, row = x0 + a * x - b * y, y0 + a * y + b * x
            if 0.0 <= column < columns and 0.0 <= row < rows:
                inside[hypothesis] += 1
                if occupied[int(row), int(column)]:
                    hit[hypothesis] += 1
    return inside, hit


def _neighbours(flat_mm: Array) -> Ints:
    """Balls around each ball, shape (M, most), filled up with -1: no ball."""
    distance = np.hypot(*(flat_mm[:, None] - flat_mm[None]).transpose(2, 0, 1))
    near = distance < HYPOTHESIS_SEARCH.neighbourhood_mm
    order = np.argsort(~near, axis=1, kind="stable")[:, : int(near.sum(axis=1).max())]
    return np.asarray(np.where(np.take_along_axis(near, order, axis=1), order, -1))


def _occupied(centre_px: Array, reach_px: float) -> tuple[Mask, Array]:
    """A map of the region where there are discs, true near them, and the pixel of its corner."""
    low = centre_px.min(axis=0) - 2.0 * reach_px
    size = np.ceil(np.ptp(centre_px, axis=0) + 4.0 * reach_px).astype(np.int64) + 1
    occupied = np.zeros((size[1], size[0]), dtype=bool)
    reach = int(reach_px)
    dy, dx = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    disc = dx**2 + dy**2 <= reach**2
    at = np.round(centre_px - low).astype(np.int64)
    occupied[at[:, 1, None] + dy[disc][None], at[:, 0, None] + dx[disc][None]] = True
    return occupied, low


def _distinct(hypotheses: Hypotheses, scale: float) -> Hypotheses:
    """Drop hypotheses that nearly equal a better one."""
    cell_px = HYPOTHESIS_SEARCH.same_offset_mm * scale
    key = np.stack(
        [
            hypotheses.mirrored.astype(np.int64),
            np.round(np.angle(hypotheses.factor) / HYPOTHESIS_SEARCH.same_angle_rad).astype(np.int64),
            np.round(hypotheses.offset.real / cell_px).astype(np.int64),
            np.round(hypotheses.offset.imag / cell_px).astype(np.int64),
        ],
        axis=1,
    )
    _, first = np.unique(key, axis=0, return_index=True)
    return hypotheses.select(np.sort(first))
