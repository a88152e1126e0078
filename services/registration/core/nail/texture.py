"""The background as a smooth random field: cubic B-splines on a grid in the nail's plane, held by a roughness prior."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.compiled import compiled
from services.registration.core.nail.bordered import lower_band


@dataclass(frozen=True, slots=True, eq=False)
class SplineField:
    """Cubic B-spline basis at given places.

    Attributes
    ----------
    corner
        Index of the first of the 4 x 4 coefficients that act at each place, shape (N,).
    order
        The places, cell by cell, shape (N,).
    cells
        Where in `order` each cell begins, and where the last ends, shape (C + 1,).
    along_weights, across_weights
        Weights of those coefficients along the two axes, shape (N, 4).
    grid
        Number of coefficients along and across.
    roughness
        Precision matrix of the prior for unit scale: squared second differences along both axes, shape (M, M).
    roughness_band
        The same as a band (see `BorderedMatrix`), as wide as any two coefficients that act at one place are apart.
    """

    corner: NDArray[np.int64]
    order: NDArray[np.int64]
    cells: NDArray[np.int64]
    along_weights: NDArray[np.float64]
    across_weights: NDArray[np.float64]
    grid: tuple[int, int]
    roughness: NDArray[np.float64]
    roughness_band: NDArray[np.float64]

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return self.grid[0] * self.grid[1]

    def at_places(self, coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
        """Value of the field at the places, shape (N,), from coefficients, shape (M,)."""
        out = np.empty(len(self.corner))
        _evaluate(self.corner, self.along_weights, self.across_weights, self.grid[1], coefficients, out)
        return out


def spline_field(along_mm: NDArray[np.float64], across_mm: NDArray[np.float64], spacing_mm: float) -> SplineField:
    """Basis for places in the nail's plane, shape (N,) each, with knots `spacing_mm` apart."""
    first, count_along, weights_along = _axis_weights(along_mm, spacing_mm)
    second, count_across, weights_across = _axis_weights(across_mm, spacing_mm)
    roughness = _roughness(count_along, count_across)
    corner = first * count_across + second
    order = np.argsort(corner, kind="stable")
    cells = np.flatnonzero(np.diff(corner[order], prepend=-1, append=-1))
    band = lower_band(roughness, 3 * count_across + 4)
    grid = count_along, count_across
    return SplineField(corner, order, cells, weights_along, weights_across, grid, roughness, band)


def _axis_weights(places: NDArray[np.float64], spacing: float) -> tuple[NDArray[np.int64], int, NDArray[np.float64]]:
    position = (places - places.min()) / spacing
    cell = np.floor(position).astype(np.int64)
    t = position - cell
    weights = np.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3], axis=1)
    return cell, int(cell.max()) + 4, weights / 6.0


def _roughness(along: int, across: int) -> NDArray[np.float64]:
    def second_differences(count: int) -> NDArray[np.float64]:
        d = np.diff(np.eye(count), n=2, axis=0)
        return np.asarray(d.T @ d)

    # mixed differences hold the coefficients that no pixel sees; the tiny ridge makes the prior proper
    d_along, d_across = np.diff(np.eye(along), axis=0), np.diff(np.eye(across), axis=0)
    mixed = np.kron(d_along.T @ d_along, d_across.T @ d_across)
    bend = np.kron(second_differences(along), np.eye(across)) + np.kron(np.eye(along), second_differences(across))
    return np.asarray(bend + 2.0 * mixed)


@compiled
def _evaluate(
    corner: NDArray[np.int64],
    along_weights: NDArray[np.float64],
    across_weights: NDArray[np.float64],
    count_across: int,
    coefficients: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    for n in range(corner.shape[0]):
        total = 0.0
        for i in range(4):
            base = corner[n] + i * count_across
            for j in range(4):
                total += along_weights[n, i] * across_weights[n, j] * coefficients[base + j]
        out[n] = total
