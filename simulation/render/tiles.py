"""Which balls may be seen in which square tile of the image, so that a ray is not tried against all of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

TILE_PX = 16
_MARGIN_PX = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class Tiles:
    """Balls by tile: those of tile i are `balls[start[i]:start[i + 1]]`; tiles run along rows."""

    start: NDArray[np.int64]
    balls: NDArray[np.int64]
    across: int


def sort_into_tiles(centre_px: NDArray[np.float64], radius_px: NDArray[np.float64], size_px: int) -> Tiles:
    """Sort discs, shape (N, 2) and (N,), into the tiles they touch with some margin for distortion and blur."""
    across = -(-size_px // TILE_PX)
    members: list[list[int]] = [[] for _ in range(across * across)]
    reach = radius_px + _MARGIN_PX
    low = np.clip(np.floor((centre_px - reach[:, None]) / TILE_PX), 0, across).astype(int)
    high = np.clip(np.floor((centre_px + reach[:, None]) / TILE_PX), -1, across - 1).astype(int)
    for ball, (first, last) in enumerate(zip(low, high, strict=True)):
        for row in range(first[1], last[1] + 1):
            for column in range(first[0], last[0] + 1):
                members[row * across + column].append(ball)
    start = np.concatenate([[0], np.cumsum([len(m) for m in members])]).astype(np.int64)
    flat = np.array([ball for m in members for ball in m], dtype=np.int64)
    return Tiles(start, flat, across)
