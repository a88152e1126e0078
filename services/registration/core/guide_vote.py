"""The inner loop of the guide's search: how many balls fall on discs, for one pair of discs and every hypothesis."""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.compiled import compiled


@compiled
def vote(
    turned_mm: NDArray[np.float64],
    first: NDArray[np.int64],
    second: NDArray[np.int64],
    rays: NDArray[np.float64],
    depth_range_mm: tuple[float, float],
    cell_from_slope: NDArray[np.float64],
    occupied: NDArray[np.uint8],
    probes: int,
) -> NDArray[np.int16]:
    """Score every direction and every ordered pair of balls, taken for one pair of discs.

    With q = (x/z, y/z) of the discs' rays and depth t of the guide's origin, the balls lie at q_a (t + z_i) and
    q_b (t + z_j) across the beam; that they are the known length apart is a quadratic equation in t.

    Parameters
    ----------
    turned_mm
        Balls turned into every direction, shape (D, N, 3).
    first, second
        Ball indices of the pairs, shape (P,).
    rays
        Slopes (x/z, y/z) of the rays through both discs, shape (2, 2).
    depth_range_mm
        Where the guide's origin may lie.
    cell_from_slope
        Affine map from slopes to cells (column, row) of the look-up map, shape (2, 3).
    occupied
        1 where a disc is near, shape (rows, columns).
    probes
        About so many balls are looked at between the points at which a hypothesis without enough hits is given up:
        two after the second look, four after the third. Balls are missing at random, so the first look decides nothing.

    Returns
    -------
    NDArray
        Number of balls on discs, shape (D, P); 0 where impossible or given up.
    """
    directions, balls = turned_mm.shape[0], turned_mm.shape[1]
    score = np.zeros((directions, len(first)), dtype=np.int16)
    ux, uy = rays[0, 0] - rays[1, 0], rays[0, 1] - rays[1, 1]
    uu = ux * ux + uy * uy
    stride = max(1, balls // probes)
    for d in range(directions):
        for p in range(len(first)):
            i, j = first[p], second[p]
            dx, dy = turned_mm[d, i, 0] - turned_mm[d, j, 0], turned_mm[d, i, 1] - turned_mm[d, j, 1]
            zi, zj = turned_mm[d, i, 2], turned_mm[d, j, 2]
            vx, vy = rays[0, 0] * zi - rays[1, 0] * zj, rays[0, 1] * zi - rays[1, 1] * zj
            length2 = dx * dx + dy * dy
            uv = ux * vx + uy * vy
            root2 = uv * uv - uu * (vx * vx + vy * vy - length2)
            if root2 <= 0.0 or length2 < 1.0:
                continue
            t = (-uv + np.sqrt(root2)) / uu
            if t < depth_range_mm[0] or t > depth_range_mm[1]:
                continue
            ax, ay = t * ux + vx, t * uy + vy
            cos, sin = (ax * dx + ay * dy) / length2, (ay * dx - ax * dy) / length2
            tx = rays[0, 0] * (t + zi) - (cos * turned_mm[d, i, 0] - sin * turned_mm[d, i, 1])
            ty = rays[0, 1] * (t + zi) - (sin * turned_mm[d, i, 0] + cos * turned_mm[d, i, 1])
            hits = 0
            seen = 0
            # balls are visited in strides, so that the first few already reach all over the pattern
            for offset in range(stride):
                for n in range(offset, balls, stride):
                    z = t + turned_mm[d, n, 2]
                    x = (cos * turned_mm[d, n, 0] - sin * turned_mm[d, n, 1] + tx) / z
                    y = (sin * turned_mm[d, n, 0] + cos * turned_mm[d, n, 1] + ty) / z
                    column = int(cell_from_slope[0, 0] * x + cell_from_slope[0, 1] * y + cell_from_slope[0, 2])
                    row = int(cell_from_slope[1, 0] * x + cell_from_slope[1, 1] * y + cell_from_slope[1, 2])
                    if 0 <= row < occupied.shape[0] and 0 <= column < occupied.shape[1]:
                        hits += occupied[row, column]
                seen += 1
                if hits < 2 * offset and offset < 3:
                    break
            score[d, p] = hits if seen == stride else 0
    return score
