"""The inner loop of the guide's search: how many balls fall on discs, for one pair of discs and every hypothesis."""

import numpy as np
from numpy.typing import NDArray

from services.registration.core.compiled import compiled

# Depth of the guide's origin (0: impossible), cosine and sine of its turn about the beam, and its place across it.
Placement = tuple[float, float, float, float, float]
_IMPOSSIBLE = (0.0, 1.0, 0.0, 0.0, 0.0)


@compiled
def _placement(
    a: NDArray[np.float64], b: NDArray[np.float64], rays: NDArray[np.float64], depth_range_mm: tuple[float, float]
) -> Placement:
    """Where the guide is when balls a and b, turned into a direction already, lie on the rays of two discs.

    With q = (x/z, y/z) of the discs' rays and depth t of the guide's origin, the balls lie at q_a (t + z_a) and
    q_b (t + z_b) across the beam; that they are the known length apart is a quadratic equation in t.
    """
    ux, uy = rays[0, 0] - rays[1, 0], rays[0, 1] - rays[1, 1]
    vx, vy = rays[0, 0] * a[2] - rays[1, 0] * b[2], rays[0, 1] * a[2] - rays[1, 1] * b[2]
    dx, dy = a[0] - b[0], a[1] - b[1]
    length2, uu, uv = dx * dx + dy * dy, ux * ux + uy * uy, ux * vx + uy * vy
    root2 = uv * uv - uu * (vx * vx + vy * vy - length2)
    if root2 <= 0.0 or length2 < 1.0:
        return _IMPOSSIBLE
    t = (-uv + np.sqrt(root2)) / uu
    if t < depth_range_mm[0] or t > depth_range_mm[1]:
        return _IMPOSSIBLE
    ax, ay = t * ux + vx, t * uy + vy
    cos, sin = (ax * dx + ay * dy) / length2, (ay * dx - ax * dy) / length2
    tx = rays[0, 0] * (t + a[2]) - (cos * a[0] - sin * a[1])
    ty = rays[0, 1] * (t + a[2]) - (sin * a[0] + cos * a[1])
    return t, cos, sin, tx, ty


@compiled
def _balls_on_discs(
    turned_mm: NDArray[np.float64],
    placement: Placement,
    cell_from_slope: NDArray[np.float64],
    occupied: NDArray[np.uint8],
    stride: int,
) -> int:
    """Number of balls, shape (N, 3), on discs; 0 when given up."""
    t, cos, sin, tx, ty = placement
    # turn, shift and map to cells are one affine step
    (c0, c1, column0), (r0, r1, row0) = cell_from_slope[0], cell_from_slope[1]
    cx, cy, ct = c0 * cos + c1 * sin, c1 * cos - c0 * sin, c0 * tx + c1 * ty
    rx, ry, rt = r0 * cos + r1 * sin, r1 * cos - r0 * sin, r0 * tx + r1 * ty
    rows, columns = np.uint64(occupied.shape[0]), np.uint64(occupied.shape[1])
    hits = 0
    # balls are visited in strides, so that the first few already reach all over the pattern
    for offset in range(stride):
        for n in range(offset, turned_mm.shape[0], stride):
            x, y = turned_mm[n, 0], turned_mm[n, 1]
            nearness = 1.0 / (t + turned_mm[n, 2])
            # without a sign, what lies before the first row or column lies far behind the last
            column = np.uint64(int((cx * x + cy * y + ct) * nearness + column0))
            row = np.uint64(int((rx * x + ry * y + rt) * nearness + row0))
            if row < rows and column < columns:
                hits += occupied[row, column]
        if hits < 2 * offset and offset < 3:
            return 0
    return hits


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
    stride = max(1, balls // probes)
    for d in range(directions):
        turned = turned_mm[d]
        for p in range(len(first)):
            placement = _placement(turned[first[p]], turned[second[p]], rays, depth_range_mm)
            if placement[0] > 0.0:
                score[d, p] = _balls_on_discs(turned, placement, cell_from_slope, occupied, stride)
    return score
