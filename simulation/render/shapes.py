"""Ray against shape, in closed form: the stretch `(enter, leave)` of the ray inside a convex shape.

The ray is `origin + t * direction` with any length of `direction`; a miss is `enter >= leave`. Shapes are packed in
rows of float64 arrays so that numba can walk them; the packing is written beside each function.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_MISS = (1.0, 0.0)
_TINY = 1e-12


@njit(cache=True, error_model="numpy", inline="always")
def slab(origin: float, direction: float, low: float, high: float) -> tuple[float, float]:
    """Stretch of a ray between two parallel planes, along one coordinate."""
    if abs(direction) < _TINY:
        return (-1e30, 1e30) if low <= origin <= high else _MISS
    a, b = (low - origin) / direction, (high - origin) / direction
    return (a, b) if a < b else (b, a)


@njit(cache=True, error_model="numpy")
def sphere(row: Floats, o: Floats, d: Floats) -> tuple[float, float]:
    """`row = [cx, cy, cz, radius]`."""
    x, y, z = o[0] - row[0], o[1] - row[1], o[2] - row[2]
    a = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    b = x * d[0] + y * d[1] + z * d[2]
    c = x * x + y * y + z * z - row[3] * row[3]
    root = b * b - a * c
    if root <= 0.0:
        return _MISS
    s = np.sqrt(root)
    return (-b - s) / a, (-b + s) / a


@njit(cache=True, error_model="numpy")
def ellipsoid(row: Floats, o: Floats, d: Floats) -> tuple[float, float]:
    """`row = [cx, cy, cz, M (9, row by row)]`, where M maps an offset from the centre to the unit sphere."""
    a = b = c = 0.0
    for i in range(3):
        q = e = 0.0
        for k in range(3):
            m = row[3 + 3 * i + k]
            q += m * (o[k] - row[k])
            e += m * d[k]
        a += e * e
        b += q * e
        c += q * q
    root = b * b - a * (c - 1.0)
    if root <= 0.0:
        return _MISS
    s = np.sqrt(root)
    return (-b - s) / a, (-b + s) / a


@njit(cache=True, error_model="numpy")
def frustum(row: Floats, o: Floats, d: Floats) -> tuple[float, float]:
    """A straight or conical piece of a round bar.

    `row = [px, py, pz, ax, ay, az, radius at the point, slope of the radius along the axis, from, to]`; the axis is a
    unit vector, the radius must be positive between `from` and `to`.
    """
    x, y, z = o[0] - row[0], o[1] - row[1], o[2] - row[2]
    along0 = x * row[3] + y * row[4] + z * row[5]
    along1 = d[0] * row[3] + d[1] * row[4] + d[2] * row[5]
    near, far = slab(along0, along1, row[8], row[9])
    if near >= far:
        return _MISS
    r0, r1 = row[6] + row[7] * along0, row[7] * along1
    a = d[0] * d[0] + d[1] * d[1] + d[2] * d[2] - along1 * along1 - r1 * r1
    b = x * d[0] + y * d[1] + z * d[2] - along0 * along1 - r0 * r1
    c = x * x + y * y + z * z - along0 * along0 - r0 * r0
    root = b * b - a * c
    if abs(a) < _TINY:
        return (near, far) if c <= 0.0 else _MISS
    if a > 0.0:
        if root <= 0.0:
            return _MISS
        s = np.sqrt(root)
        return max(near, (-b - s) / a), min(far, (-b + s) / a)
    # Steeper than the cone's wall: inside is everything outside the two roots, one nappe each.
    if root <= 0.0:
        return near, far
    s = np.sqrt(root)
    first, second = (-b + s) / a, (-b - s) / a
    if near < first:
        return near, min(far, first)
    return max(near, second), far


@njit(cache=True, error_model="numpy")
def flared_block(row: Floats, o: Floats, d: Floats) -> tuple[float, float]:
    """A straight or flaring piece of a rectangular bar.

    `row = [px, py, pz, ax, ay, az, lx, ly, lz, half length along l, half width at the point, slope of the half width
    along the axis, from, to]`; axis and l are unit vectors across each other, and the half width must be positive
    between `from` and `to`.
    """
    p, q, m, n, v, w = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    wx, wy, wz = row[4] * row[8] - row[5] * row[7], row[5] * row[6] - row[3] * row[8], row[3] * row[7] - row[4] * row[6]
    for i in range(3):
        across = wx if i == 0 else (wy if i == 1 else wz)
        offset = o[i] - row[i]
        p += row[3 + i] * offset
        q += row[3 + i] * d[i]
        m += row[6 + i] * offset
        n += row[6 + i] * d[i]
        v += across * offset
        w += across * d[i]
    near, far = slab(p, q, row[12], row[13])
    a, b = slab(m, n, -row[9], row[9])
    near, far = max(near, a), min(far, b)
    # either side: slope * along + half width at the point -+ across >= 0
    for side in (-1.0, 1.0):
        a, b = slab(row[10] + row[11] * p + side * v, row[11] * q + side * w, 0.0, 1e30)
        near, far = max(near, a), min(far, b)
    return near, far


@njit(cache=True, error_model="numpy")
def box(row: Floats, axes: Floats, o: Floats, d: Floats) -> tuple[float, float]:
    """`row = [cx, cy, cz, half x, half y, half z]`; the rows of `axes`, shape (3, 3), are the box's unit axes."""
    near, far = -1e30, 1e30
    for i in range(3):
        p = q = 0.0
        for k in range(3):
            p += axes[i, k] * (o[k] - row[k])
            q += axes[i, k] * d[k]
        a, b = slab(p, q, -row[3 + i], row[3 + i])
        near, far = max(near, a), min(far, b)
    return near, far
