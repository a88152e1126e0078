"""First guesses of where the ring lies in the image: pairs of discs laid on pairs of balls."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from shared.geometry.calibration import BallCandidates

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Complexes = NDArray[np.complex128]

_LONGEST_MM = 48.0
_SHORTEST_MM = 12.0
_SCALE_TOLERANCE = 0.18
_IMAGE_PAIRS = 90
_CLEAREST = 220
_NEIGHBOURHOOD_MM = 45.0
_REACH_PX = 7.0
_CHUNK = 6000
_KEPT = 4000


@dataclass(frozen=True, slots=True, eq=False)
class Seeds:
    """Similarities from the flat ring to the image, best first, written as complex numbers.

    `pixel = factor * flat + offset`, with the flat pattern's y negated first where `mirrored`.

    Attributes
    ----------
    factor, offset
        Shape (S,).
    mirrored
        Shape (S,).
    anchor
        The ball from which the guess was made, shape (S,): there it is most exact.
    """

    factor: Complexes
    offset: Complexes
    mirrored: NDArray[np.bool_]
    anchor: Ints

    def __len__(self) -> int:
        return len(self.factor)

    def select(self, which: Ints) -> "Seeds":
        """Those of an index array."""
        return Seeds(self.factor[which], self.offset[which], self.mirrored[which], self.anchor[which])

    def predict(self, index: int, flat_mm: Array) -> Array:
        """Pixels, shape (M, 2), of points of the flat pattern, shape (M, 2)."""
        z = _complex(flat_mm)
        z = np.conj(z) if self.mirrored[index] else z
        pixel = self.factor[index] * z + self.offset[index]
        return np.stack([pixel.real, pixel.imag], axis=1)


def _complex(points: Array) -> Complexes:
    return np.asarray(points[:, 0] + 1j * points[:, 1])


def make_seeds(candidates: BallCandidates, flat_mm: Array, plate: Ints, scale_px_per_mm: float) -> Seeds:
    """Lay pairs of discs on pairs of balls of one plate and score each guess in its neighbourhood.

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
    Seeds
        Distinct guesses, best first.
    """
    discs = _complex(candidates.centre_px)
    balls = _complex(flat_mm)
    disc_pairs = _disc_pairs(candidates.centre_px[:_CLEAREST], scale_px_per_mm)
    ball_pairs = _ball_pairs(flat_mm, plate)
    parts = [
        _guesses(discs, disc_pairs, np.conj(balls) if mirrored else balls, ball_pairs, scale_px_per_mm)
        for mirrored in (False, True)
    ]
    factor, offset = (np.concatenate([p[i] for p in parts]) for i in range(2))
    pair = np.concatenate([p[2] for p in parts])
    mirrored = np.repeat([False, True], [len(p[0]) for p in parts])
    seeds = Seeds(factor, offset, mirrored, ball_pairs[pair, 0])
    return _distinct(_scored(seeds, candidates, flat_mm), scale_px_per_mm)


def _disc_pairs(centre_px: Array, scale: float) -> Ints:
    """Pairs of neighbouring discs from all over the image, those of the clearest discs first, shape (P, 2)."""
    tree = cKDTree(centre_px)
    pairs = tree.query_pairs(_LONGEST_MM * scale, output_type="ndarray").astype(np.int64)
    length = np.hypot(*(centre_px[pairs[:, 0]] - centre_px[pairs[:, 1]]).T)
    pairs = pairs[length > 1.5 * _SHORTEST_MM * scale]
    order = np.argsort(pairs.max(axis=1), kind="stable")
    pairs = pairs[order]
    # Every disc in a few pairs only: a clear disc that is not of the ring must not use up all guesses.
    used = np.zeros(len(centre_px), dtype=np.int64)
    kept: list[int] = []
    for index, (a, b) in enumerate(pairs):
        if used[a] < 3 and used[b] < 3:
            used[a] += 1
            used[b] += 1
            kept.append(index)
        if len(kept) == _IMAGE_PAIRS:
            break
    return np.asarray(pairs[kept])


def _ball_pairs(flat_mm: Array, plate: Ints) -> Ints:
    """Ordered pairs of balls of one plate, shape (Q, 2)."""
    tree = cKDTree(flat_mm)
    pairs = tree.query_pairs(_LONGEST_MM * (1.0 + _SCALE_TOLERANCE), output_type="ndarray").astype(np.int64)
    pairs = pairs[plate[pairs[:, 0]] == plate[pairs[:, 1]]]
    return np.concatenate([pairs, pairs[:, ::-1]])


def _guesses(
    discs: Complexes, disc_pairs: Ints, balls: Complexes, ball_pairs: Ints, scale: float
) -> tuple[Complexes, Complexes, Ints]:
    """Similarities of all pairs of pairs whose scale is about right: factor, offset and ball pair, shape (S,) each."""
    from_disc, to_disc = discs[disc_pairs].T
    from_ball, to_ball = balls[ball_pairs].T
    factor = (to_disc - from_disc)[:, None] / (to_ball - from_ball)[None]
    right = np.abs(np.log(np.abs(factor) / scale)) < _SCALE_TOLERANCE
    rows, columns = np.nonzero(right)
    chosen = factor[rows, columns]
    return chosen, from_disc[rows] - chosen * from_ball[columns], columns.astype(np.int64)


def _scored(seeds: Seeds, candidates: BallCandidates, flat_mm: Array) -> Seeds:
    """Count discs close to the predicted balls of each guess's neighbourhood; keep the best guesses, best first."""
    occupied = _Occupied(candidates.centre_px)
    neighbours = _neighbours(flat_mm)
    z = np.append(_complex(flat_mm), np.nan)
    both = np.stack([z, np.conj(z)])
    score = np.empty(len(seeds))
    for start in range(0, len(seeds), _CHUNK):
        part = slice(start, start + _CHUNK)
        where = both[seeds.mirrored[part].astype(np.int64)[:, None], neighbours[seeds.anchor[part]]]
        inside, hit = occupied.look(seeds.factor[part, None] * where + seeds.offset[part, None])
        count = np.count_nonzero(inside, axis=1)
        score[part] = (np.count_nonzero(hit, axis=1) - occupied.density * count) / np.sqrt(np.maximum(count, 6))
    return seeds.select(np.argsort(-score, kind="stable")[:_KEPT])


def _neighbours(flat_mm: Array) -> Ints:
    """Balls around each ball, shape (M, most), filled up with M: no ball."""
    distance = np.hypot(*(flat_mm[:, None] - flat_mm[None]).transpose(2, 0, 1))
    near = distance < _NEIGHBOURHOOD_MM
    order = np.argsort(~near, axis=1, kind="stable")[:, : int(near.sum(axis=1).max())]
    return np.asarray(np.where(np.take_along_axis(near, order, axis=1), order, len(flat_mm)))


class _Occupied:
    """A map of the image that is true near discs."""

    def __init__(self, centre_px: Array) -> None:
        self._low = centre_px.min(axis=0) - 2.0 * _REACH_PX
        size = np.ceil(np.ptp(centre_px, axis=0) + 4.0 * _REACH_PX).astype(np.int64) + 1
        self._map = np.zeros((size[1], size[0]), dtype=bool)
        reach = int(_REACH_PX)
        dy, dx = np.mgrid[-reach : reach + 1, -reach : reach + 1]
        disc = dx**2 + dy**2 <= reach**2
        at = np.round(centre_px - self._low).astype(np.int64)
        self._map[at[:, 1, None] + dy[disc][None], at[:, 0, None] + dx[disc][None]] = True
        self.density = float(self._map.mean())

    def look(self, pixel: Complexes) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Whether pixels lie in the region where there are discs, and whether a disc is near; NaN lies nowhere."""
        rows, columns = self._map.shape
        column, row = pixel.real - self._low[0], pixel.imag - self._low[1]
        inside = (column >= 0) & (row >= 0) & (column < columns) & (row < rows)
        index = np.where(inside, row, 0.0).astype(np.int64) * columns + np.where(inside, column, 0.0).astype(np.int64)
        return inside, np.asarray(self._map.ravel()[index] & inside)


def _distinct(seeds: Seeds, scale: float) -> Seeds:
    """Drop guesses that say nearly the same as a better one."""
    key = np.stack(
        [
            seeds.mirrored.astype(np.int64),
            np.round(np.angle(seeds.factor) / 0.08).astype(np.int64),
            np.round(seeds.offset.real / (6.0 * scale)).astype(np.int64),
            np.round(seeds.offset.imag / (6.0 * scale)).astype(np.int64),
        ],
        axis=1,
    )
    _, first = np.unique(key, axis=0, return_index=True)
    return seeds.select(np.sort(first))
