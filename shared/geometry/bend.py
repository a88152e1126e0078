"""A nail that bends: frames of its cross-sections along a centre line of constant curvature.

The curvature (k_y, k_z) is that of the centre line in the nail's frame: it leaves the nail's origin along x and turns
towards (0, k_y, k_z). The frame of the cross-section at the arc length x is exp(x * twist), with the twist of rotation
(0, -k_z, k_y) and translation (1, 0, 0) per millimetre: each cross-section stays plane and square to the centre line.
"""

import numpy as np
from numpy.typing import NDArray

from shared.geometry.frames import Nail
from shared.geometry.lines import cross_matrix
from shared.geometry.transform import Transform

MM_PER_M = 1e3  # of the units
# Terms of a series in the angle between origin and cross-section: the next is below 1e-8 at 0.1 rad.
_TERMS = 6


def bend_twist(curvature_per_m: tuple[float, float]) -> NDArray[np.float64]:
    """Motion of a cross-section per mm of length in its own frame, shape (6,): rotation (rad), translation (mm)."""
    y, z = curvature_per_m
    return np.array([0.0, -z / MM_PER_M, y / MM_PER_M, 1.0, 0.0, 0.0])


def section_frame(curvature_per_m: tuple[float, float], x_mm: float) -> Transform[Nail, Nail]:
    """Nail from the cross-section at an arc length, whose middle is the origin."""
    return Transform.exp(x_mm * bend_twist(curvature_per_m))


def section_motions(curvature_per_m: tuple[float, float]) -> NDArray[np.float64]:
    """Coefficients of the motion of cross-sections, in the nail's frame, by k_y and k_z (1/m): shape (terms, 6, 2).

    At the arc length x the motion is the sum of x^(n+1) times the n-th: the derivative of the matrix exponential.
    """
    rotation, translation = np.split(bend_twist(curvature_per_m), 2)
    bracket = np.zeros((6, 6))
    bracket[:3, :3] = bracket[3:, 3:] = cross_matrix(rotation)
    bracket[3:, :3] = cross_matrix(translation)
    term = np.zeros((6, 2))
    term[2, 0], term[1, 1] = 1.0 / MM_PER_M, -1.0 / MM_PER_M
    terms = [term]
    for n in range(2, _TERMS + 1):
        terms.append(bracket @ terms[-1] / n)
    return np.stack(terms)


def motion_by_curvature(curvature_per_m: tuple[float, float], x_mm: float) -> NDArray[np.float64]:
    """Small motion of one cross-section in the nail's frame by k_y and k_z (1/m), shape (6, 2)."""
    terms = section_motions(curvature_per_m)
    return np.asarray(np.tensordot(x_mm ** np.arange(1.0, len(terms) + 1), terms, axes=1))


def places_along(
    spot_mm: NDArray[np.float64], directions: NDArray[np.float64], curvature_per_m: tuple[float, float]
) -> NDArray[np.float64]:
    """Arc lengths in mm where rays pass nearest to the centre line, shape (N,).

    Parameters
    ----------
    spot_mm, directions
        Of the rays in the nail's frame: focal spot, shape (3,), and directions, shape (N, 3).
    """
    place = _nearest(spot_mm[None], np.array([[1.0, 0.0, 0.0]]), directions)
    size = float(np.hypot(*curvature_per_m)) / MM_PER_M
    if size == 0.0:
        return place
    towards = np.array([0.0, *curvature_per_m]) / (MM_PER_M * size)
    ahead = np.array([1.0, 0.0, 0.0])
    for _ in range(2):  # the second step changes it by less than a hundredth of a millimetre
        sine, cosine = np.sin(size * place)[:, None], np.cos(size * place)[:, None]
        middle = (sine * ahead + (1.0 - cosine) * towards) / size
        place = place + _nearest(spot_mm - middle, cosine * ahead + sine * towards, directions)
    return place


def _nearest(
    spot_mm: NDArray[np.float64], along: NDArray[np.float64], directions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Where on lines through the origin rays pass nearest to them, shape (N,)."""
    squared = np.sum(directions * directions, axis=1)
    lean = np.sum(directions * along, axis=1)
    numerator = np.sum(spot_mm * along, axis=1) * squared - np.sum(spot_mm * directions, axis=1) * lean
    return np.asarray(numerator / (squared - lean * lean))
