"""The femur's shaft and its flare towards the condyles, as a tube of elliptic sections.

Half-axes of the section follow a smooth step along the bone; the distal end is closed by ellipsoids (see `scene`).
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from simulation.render.shapes import slab

Floats = NDArray[np.float64]
_ROUNDS = 4


@njit(cache=True, error_model="numpy", inline="always")
def flare(x: float, start: float, end: float) -> float:
    """Smooth step from 0 at `start` to 1 at `end`."""
    s = (x - start) / (end - start)
    s = min(1.0, max(0.0, s))
    return s * s * (3.0 - 2.0 * s)


@njit(cache=True, error_model="numpy")
def _section_roots(row: Floats, at: float, o: Floats, d: Floats) -> tuple[float, float]:
    s = flare(at, row[0], row[1])
    a = row[2] + s * (row[3] - row[2])
    b = row[4] + s * (row[5] - row[4])
    oy, oz, dy, dz = o[1] / a, o[2] / b, d[1] / a, d[2] / b
    p, q, r = dy * dy + dz * dz, oy * dy + oz * dz, oy * oy + oz * oz - 1.0
    root = q * q - p * r
    if root <= 0.0:
        return 1.0, 0.0
    w = np.sqrt(root)
    return (-q - w) / p, (-q + w) / p


@njit(cache=True, error_model="numpy")
def tube(row: Floats, o: Floats, d: Floats) -> tuple[float, float]:
    """Stretch of a ray, given in the bone's frame, inside the tube.

    `row = [flare from x, flare to x, half-axis y of the shaft, of the flare, half-axis z of the shaft, of the flare,
    proximal end x, distal end x]`. Each end of the stretch is found by a fixed-point iteration over the section it lies
    in: sections change slowly along the bone, by less than the ray's own slope.
    """
    closest = -(o[1] * d[1] + o[2] * d[2]) / (d[1] * d[1] + d[2] * d[2] + 1e-12)
    near, far = _section_roots(row, o[0] + closest * d[0], o, d)
    if near >= far:
        return 1.0, 0.0
    for _ in range(_ROUNDS):
        a, b = _section_roots(row, o[0] + near * d[0], o, d)
        near = a if a < b else near
        a, b = _section_roots(row, o[0] + far * d[0], o, d)
        far = b if a < b else far
    a, b = slab(o[0], d[0], row[6], row[7])
    return max(near, a), min(far, b)
