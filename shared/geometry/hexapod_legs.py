"""How near the legs come to one another."""

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from shared.geometry.hexapod import LEGS, HexapodPart, leg_vectors_mm

PAIRS = tuple(combinations(range(LEGS), 2))
_FIRST = [i for i, _ in PAIRS]
_SECOND = [j for _, j in PAIRS]


def leg_distances_mm(
    hexapod: HexapodPart, poses: NDArray[np.float64], pivot_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distances between the axes of every two legs, from joint to joint.

    Nearest points of two segments, by clamping (Ericson, Real-Time Collision Detection, 5.1.9).

    Parameters
    ----------
    poses
        X Y Z (mm) and U V W (degrees), shape (..., 6).
    pivot_mm
        Centre of rotation in the top's frame, shape (3,).

    Returns
    -------
    NDArray
        Shape (..., 15), in mm, in the order of `PAIRS`.
    """
    legs = leg_vectors_mm(hexapod, poses, pivot_mm)
    along_a, along_b = legs[..., _FIRST, :], legs[..., _SECOND, :]
    between = hexapod.base_joints_mm[_FIRST] - hexapod.base_joints_mm[_SECOND]
    aa, bb, ab = _dot(along_a, along_a), _dot(along_b, along_b), _dot(along_a, along_b)
    a_between, b_between = _dot(along_a, between), _dot(along_b, between)
    # Parallel legs have no single nearest pair of points: any is right, so where the first leg begins.
    skew = aa * bb - ab * ab
    share_a = np.clip((ab * b_between - a_between * bb) / np.maximum(skew, 1e-12 * aa * bb), 0.0, 1.0)
    share_b = np.clip((ab * share_a + b_between) / bb, 0.0, 1.0)
    share_a = np.clip((ab * share_b - a_between) / aa, 0.0, 1.0)
    apart = between + share_a[..., None] * along_a - share_b[..., None] * along_b
    return np.asarray(np.linalg.norm(apart, axis=-1))


def leg_clearances_mm(
    hexapod: HexapodPart, poses: NDArray[np.float64], pivot_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Free space between the two nearest legs, shape (...), in mm; negative when they would touch."""
    return np.asarray(leg_distances_mm(hexapod, poses, pivot_mm).min(axis=-1) - hexapod.leg_diameter_mm)


def _dot(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.einsum("...i,...i->...", a, b))
