"""Leg lengths of very many poses: the formula of `hexapod.leg_lengths_mm`, arranged for speed.

With the arm a from the pivot to a leg's top joint, the base joint b as seen from where the pivot is in the zero pose,
rotation R and displacement x, the square of a leg's length is

    |x + R a - b|² = |a|² + |b|² + |x|² + 2 (R'x)·a - 2 x·b - 2 b·R a,

which is linear in 16 numbers that all legs share: R, R'x, x and |x|². So a block of poses needs one small matrix
product, and a block that stays in the processor's cache is what makes it several times faster.
"""

import numpy as np
from numpy.typing import NDArray

from shared.geometry.hexapod import LEGS, HexapodPart

# Poses in one block: 4096 x 16 numbers of 8 bytes fit into the cache of one core.
BLOCK = 4096
_SHARED = 16


def leg_lengths_of_many_mm(
    hexapod: HexapodPart, poses: NDArray[np.float64], pivot_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Lengths of the legs, shape (N, 6), in mm.

    Parameters
    ----------
    poses
        X Y Z (mm) and U V W (degrees), shape (N, 6).
    pivot_mm
        Centre of rotation in the top's frame, shape (3,).
    """
    weights, offsets = _weights(hexapod, pivot_mm)
    lengths = np.empty((len(poses), LEGS))
    shared = np.empty((_SHARED, BLOCK))
    for begin in range(0, len(poses), BLOCK):
        block = poses[begin : begin + BLOCK]
        numbers = shared[:, : len(block)]
        _fill(numbers, block.T)
        squares = weights @ numbers
        squares += offsets[:, None]
        lengths[begin : begin + BLOCK] = np.sqrt(squares).T
    return lengths


def _weights(hexapod: HexapodPart, pivot_mm: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Factors of the shared numbers, shape (6, 16), and what is added, shape (6,)."""
    arms = hexapod.top_joints_mm - pivot_mm
    bases = hexapod.base_joints_mm - pivot_mm - np.array([0.0, 0.0, hexapod.zero_height_mm])
    of_rotation = -2.0 * (bases[:, :, None] * arms[:, None, :]).reshape(LEGS, 9)
    weights = np.concatenate([of_rotation, 2.0 * arms, -2.0 * bases, np.ones((LEGS, 1))], axis=1)
    return np.ascontiguousarray(weights), np.sum(arms**2 + bases**2, axis=1)


def _fill(numbers: NDArray[np.float64], poses: NDArray[np.float64]) -> None:
    """Write R (row by row), R'x, x and |x|², shape (16, N), of poses, shape (6, N)."""
    x = poses[:3]
    angles = np.radians(poses[3:])
    su, sv, sw = np.sin(angles)
    cu, cv, cw = np.cos(angles)
    susv, cusv = su * sv, cu * sv
    numbers[0], numbers[1], numbers[2] = cv * cw, -cv * sw, sv
    numbers[3], numbers[4], numbers[5] = cu * sw + susv * cw, cu * cw - susv * sw, -su * cv
    numbers[6], numbers[7], numbers[8] = su * sw - cusv * cw, su * cw + cusv * sw, cu * cv
    numbers[9:12] = numbers[0:3] * x[0] + numbers[3:6] * x[1] + numbers[6:9] * x[2]
    numbers[12:15] = x
    numbers[15] = x[0] ** 2 + x[1] ** 2 + x[2] ** 2
