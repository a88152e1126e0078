"""Normal equations of a field, whose coefficients know only their neighbours, and of a few columns that act everywhere.

The field's block is a band; what it has in common with the others is a border. Solved so, the equations cost a small
part of what they would as a full matrix.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, cholesky_banded
from scipy.linalg.lapack import dtbtrs


class BorderedMatrix(NamedTuple):
    """A symmetric matrix of M + D rows.

    Attributes
    ----------
    band
        Of the first M rows: place (m, k) holds what stands in row m + k and column m, shape (M, width).
    border
        The last D rows without their last D columns, shape (D, M).
    corner
        The last D rows and columns, shape (D, D), of which the lower triangle counts.
    """

    band: NDArray[np.float64]
    border: NDArray[np.float64]
    corner: NDArray[np.float64]

    @staticmethod
    def of_zeros(size: int, width: int, dense: int) -> "BorderedMatrix":
        """Nothing yet, for M = `size` and D = `dense`."""
        return BorderedMatrix(np.zeros((size, width)), np.zeros((dense, size)), np.zeros((dense, dense)))

    def add_to_diagonal(self, share_of_mean: float) -> None:
        """Raise the diagonal by a share of its mean, in place."""
        in_corner = np.diag_indices(len(self.corner))
        total = float(self.band[:, 0].sum() + self.corner[in_corner].sum())
        rise = share_of_mean * total / (len(self.band) + len(self.corner))
        self.band[:, 0] += rise
        self.corner[in_corner] += rise


@dataclass(frozen=True, slots=True, eq=False)
class Factor:
    """The Cholesky factor, block by block.

    Attributes
    ----------
    band
        Of the field's block, as LAPACK holds it, shape (width, M).
    border
        What stands beside it, transposed, shape (M, D).
    corner
        The last block, shape (D, D).
    """

    band: NDArray[np.float64]
    border: NDArray[np.float64]
    corner: NDArray[np.float64]

    def solved(self, sides: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solution for right-hand sides of shape (M + D,) or (M + D, T), of the same shape."""
        size = len(self.border)
        of_field = _through_band(self.band, sides[:size])
        of_dense = cho_solve((self.corner, True), sides[size:] - self.border.T @ of_field, check_finite=False)
        return np.concatenate([_through_band(self.band, of_field - self.border @ of_dense, transposed=True), of_dense])


def factorised(matrix: BorderedMatrix) -> Factor:
    """Factor a matrix, which must be positive definite; its band is overwritten."""
    band = cholesky_banded(matrix.band.T, overwrite_ab=True, lower=True, check_finite=False)
    border = _through_band(band, matrix.border.T)
    corner, _ = cho_factor(matrix.corner - border.T @ border, lower=True, check_finite=False)
    return Factor(band, border, corner)


def _through_band(
    band: NDArray[np.float64], sides: NDArray[np.float64], *, transposed: bool = False
) -> NDArray[np.float64]:
    """Solve with the factor of a band, or with its transpose, for sides of shape (M,) or (M, T)."""
    solution, fault = dtbtrs(band, sides.reshape(len(sides), -1), uplo="L", trans="T" if transposed else "N")
    if fault:
        raise np.linalg.LinAlgError(f"row {abs(fault)} of a band's factor cannot be solved")
    return np.asarray(solution).reshape(sides.shape)


def lower_band(matrix: NDArray[np.float64], width: int) -> NDArray[np.float64]:
    """Band of a symmetric matrix, shape (M, M), that has nothing beyond it, as `BorderedMatrix` holds it."""
    size = len(matrix)
    band = np.zeros((size, width))
    for k in range(min(width, size)):
        band[: size - k, k] = np.diagonal(matrix, -k)
    return band
