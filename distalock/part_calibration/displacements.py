"""Bundle adjustment of ball displacements: each image's own unknowns are eliminated, the balls' are shared by all.

Displacements from the file's places are normal with one unknown standard deviation, which the images determine with
them (expectation maximisation). That prior also fixes the gauge: what no image shows (the place and direction of all
balls together, the size of the part, smooth patterns that an image's distortion explains) stays as the file has it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_ROUNDS = 200
_CONVERGED = 1e-4
_FIRST_SD_MM, _LEAST_SD_MM = 0.1, 1e-3


@dataclass(frozen=True, slots=True, eq=False)
class ViewEquations:
    """Normal equations of one image for the displacements of B balls along D axes, its own unknowns eliminated.

    Attributes
    ----------
    normal, gradient
        Shapes (B * D, B * D) and (B * D,): ``normal @ displacement = gradient`` for displacements from the file.
    """

    normal: Array
    gradient: Array


@dataclass(frozen=True, slots=True, eq=False)
class Displacements:
    """Displacements of a part's balls from the file.

    Attributes
    ----------
    mean_mm
        Shape (B, D).
    covariance_mm2
        Of all of them, what no image shows included, shape (B * D, B * D).
    spread_mm
        Standard deviation of displacements per axis: how well the part was built.
    """

    mean_mm: Array
    covariance_mm2: Array
    spread_mm: float

    def ball_covariance_mm2(self, ball: int) -> Array:
        """Of one ball, shape (D, D)."""
        axes = self.mean_mm.shape[1]
        rows = slice(ball * axes, (ball + 1) * axes)
        return np.asarray(self.covariance_mm2[rows, rows])


def solve_displacements(views: Sequence[ViewEquations], balls: int, axes: int) -> Displacements:
    """Most likely displacements, their covariance and their spread."""
    normal, gradient = sum(view.normal for view in views), sum(view.gradient for view in views)
    values, vectors = np.linalg.eigh(np.asarray(normal))
    values, along = np.maximum(values, 0.0), vectors.T @ np.asarray(gradient)
    variance = _FIRST_SD_MM**2
    for _ in range(_ROUNDS):
        posterior = 1.0 / (values + 1.0 / variance)
        before, variance = variance, float(np.mean((posterior * along) ** 2 + posterior))
        variance = max(variance, _LEAST_SD_MM**2)
        if abs(variance - before) < _CONVERGED * before:
            break
    posterior = 1.0 / (values + 1.0 / variance)
    mean = vectors @ (posterior * along)
    covariance = (vectors * posterior) @ vectors.T
    return Displacements(mean.reshape(balls, axes), np.asarray(covariance), float(np.sqrt(variance)))


def rigid_motions(position_mm: Array) -> Array:
    """How balls move with small rotations and translations of all together, shape (3 B, 6), per rad and per mm."""
    cross = np.stack([np.cross(axis, position_mm) for axis in np.eye(3)], axis=-1)
    return np.concatenate([cross, np.broadcast_to(np.eye(3), (len(position_mm), 3, 3))], axis=2).reshape(-1, 6)


def without(covariance: Array, directions: Array) -> Array:
    """Covariance of what is left when the directions, columns, are projected out."""
    basis = np.linalg.qr(directions)[0]
    projector = np.eye(len(covariance)) - basis @ basis.T
    return np.asarray(projector @ covariance @ projector)
