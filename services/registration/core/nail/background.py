"""The background as a smooth random field: cubic B-splines on a grid in the nail's plane with a roughness prior.

Its coefficients couple only to their neighbours: the field's block of the normal equations is a band, and the few
columns that act everywhere are a border. Solved so, the equations cost a small part of what a full matrix would.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import cho_factor, cho_solve, cholesky_banded
from scipy.linalg.lapack import dtbtrs

from shared.compiled import compiled, compiled_inline
from shared.two_cores import on_both_halves

# Precision of the roughness over the usual one, shape (A, C), at places along the nail, (A, 1), and across it, (C,).
Stiffness = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]

# A bicubic cell has four by four coefficients.
_IN_CELL = 16
# Guard: keeps the matrix positive definite where no pixel determines a coefficient.
_LEAST_RIDGE = 1e-9
# Orders of the differences along and across, and how often each counts in the sum of all second derivatives' squares.
# Mixed ones determine the coefficients that no pixel depends on.
_ROUGHNESS = ((2, 0, 1.0), (0, 2, 1.0), (1, 1, 2.0))
# Guard: keeps the prior's matrix positive definite, which leaves planes free; over the roughness.
_PLANES_RIDGE = 1e-9
# The equations of fewer cells are summed sooner than handed to another core.
_LEAST_CELLS_TO_SHARE = 100


class BorderedMatrix(NamedTuple):
    """A symmetric matrix of M + D rows."""

    # Of the first M rows: place (m, k) holds what stands in row m + k and column m, shape (M, width)
    band: NDArray[np.float64]
    border: NDArray[np.float64]  # the last D rows without their last D columns, shape (D, M)
    corner: NDArray[np.float64]  # the last D rows and columns, shape (D, D), of which the lower triangle counts

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
class BorderedFactor:
    """The Cholesky factor, block by block."""

    band: NDArray[np.float64]  # of the field's block, as LAPACK holds it, shape (width, M)
    border: NDArray[np.float64]  # what stands beside it, transposed, shape (M, D)
    corner: NDArray[np.float64]  # the last block, shape (D, D)

    @property
    def log_determinant(self) -> float:
        """Logarithm of the matrix's determinant."""
        return 2.0 * float(np.log(self.band[0]).sum() + np.log(np.diagonal(self.corner)).sum())

    def solved(self, sides: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solution for right-hand sides of shape (M + D,) or (M + D, T), of the same shape."""
        size = len(self.border)
        of_field = _through_band(self.band, sides[:size])
        of_dense = cho_solve((self.corner, True), sides[size:] - self.border.T @ of_field, check_finite=False)
        return np.concatenate([_through_band(self.band, of_field - self.border @ of_dense, transposed=True), of_dense])


def cholesky_factor(matrix: BorderedMatrix) -> BorderedFactor:
    """Factor a matrix, which must be positive definite; its band is overwritten."""
    band = cholesky_banded(matrix.band.T, overwrite_ab=True, lower=True, check_finite=False)
    border = _through_band(band, matrix.border.T)
    corner, _ = cho_factor(matrix.corner - border.T @ border, lower=True, check_finite=False)
    return BorderedFactor(band, border, corner)


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


class SplineField(NamedTuple):
    """Cubic B-spline basis at given places."""

    corner: NDArray[np.int64]  # index of the first of the 4 x 4 coefficients that act at each place, shape (N,)
    order: NDArray[np.int64]  # the places, cell by cell, shape (N,)
    cells: NDArray[np.int64]  # where in `order` each cell begins, and where the last ends, shape (C + 1,)
    # Weights of those coefficients along the two axes, shape (N, 4)
    along_weights: NDArray[np.float64]
    across_weights: NDArray[np.float64]
    grid: tuple[int, int]  # number of coefficients along and across
    # Precision matrix of the prior for unit scale: squared second and mixed differences, shape (M, M)
    roughness: NDArray[np.float64]
    # The same as a band (see `BorderedMatrix`), as wide as any two coefficients that act at one place are apart
    roughness_band: NDArray[np.float64]

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return self.grid[0] * self.grid[1]

    def log_prior_determinant(self, precision: float) -> float:
        """Logarithm of the determinant of the prior's precision, up to what is the same for every stiffness."""
        band = precision * self.roughness_band.T
        band[0] += _PLANES_RIDGE * precision
        return 2.0 * float(np.log(cholesky_banded(band, lower=True, check_finite=False)[0]).sum())

    def at_places(self, coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
        """Value of the field at the places, shape (N,), from coefficients, shape (M,)."""
        out = np.empty(len(self.corner))
        _evaluate(self.corner, self.along_weights, self.across_weights, self.grid[1], coefficients, out)
        return out


def equally_stiff(along_mm: NDArray[np.float64], across_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """The stiffness of a field that is as smooth in one place as in another."""
    return np.ones(np.broadcast_shapes(along_mm.shape, across_mm.shape))


def spline_field(
    along_mm: NDArray[np.float64],
    across_mm: NDArray[np.float64],
    spacing_mm: float,
    stiffness: Stiffness = equally_stiff,
) -> SplineField:
    """Basis for places in the nail's plane, shape (N,) each, with knots `spacing_mm` apart."""
    first, count_along, weights_along = _axis_weights(along_mm, spacing_mm)
    second, count_across, weights_across = _axis_weights(across_mm, spacing_mm)
    roughness = _roughness(
        _coefficient_places(along_mm, spacing_mm, count_along),
        _coefficient_places(across_mm, spacing_mm, count_across),
        stiffness,
    )
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


def _coefficient_places(places_mm: NDArray[np.float64], spacing_mm: float, count: int) -> NDArray[np.float64]:
    """Where each coefficient along an axis acts most: the first of a cell's one knot before it."""
    return np.asarray(places_mm.min() + spacing_mm * (np.arange(count) - 1.0))


def _roughness(
    along_mm: NDArray[np.float64], across_mm: NDArray[np.float64], stiffness: Stiffness
) -> NDArray[np.float64]:
    """Squared differences of coefficients at such places, each as stiff as the field is there, shape (M, M)."""
    size = len(along_mm) * len(across_mm)
    total = sparse.csr_array((size, size))
    for order_along, order_across, count in _ROUGHNESS:
        along, at_along_mm = _differences(along_mm, order_along)
        across, at_across_mm = _differences(across_mm, order_across)
        differences = sparse.kron(along, across, format="csr")
        stiff = count * stiffness(at_along_mm[:, None], at_across_mm).ravel()
        total = total + differences.T @ sparse.diags_array(stiff) @ differences
    return np.asarray(total.toarray())


def _differences(places_mm: NDArray[np.float64], order: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Differences of an order along an axis, shape (D, A), and the middles of what they compare, shape (D,)."""
    differences = np.diff(np.eye(len(places_mm)), n=order, axis=0)
    share = np.abs(differences)
    return differences, share @ places_mm / share.sum(axis=1)


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


class DesignMatrix(NamedTuple):
    """The columns A = [gain * spline basis, dense] and the weights W of N pixels."""

    field: SplineField
    gain: NDArray[np.float64]  # with which the field is seen, shape (N,)
    dense: NDArray[np.float64]  # columns that act everywhere, shape (N, D)
    weight: NDArray[np.float64]  # shape (N,)


@compiled_inline
def _cell_index(columns: DesignMatrix, cell: int) -> NDArray[np.int64]:
    """Which of all coefficients the pixels of a cell depend on, increasing, shape (16 + D,)."""
    field, dense = columns.field, columns.dense.shape[1]
    index = np.empty(_IN_CELL + dense, dtype=np.int64)
    first = field.corner[field.order[field.cells[cell]]]
    for i in range(4):
        index[4 * i : 4 * i + 4] = first + i * field.grid[1] + np.arange(4)
    index[_IN_CELL:] = field.grid[0] * field.grid[1] + np.arange(dense)
    return index


@compiled_inline
def _cell_rows(columns: DesignMatrix, cell: int) -> NDArray[np.float64]:
    """What is not zero of A in the rows of a cell's pixels, shape (pixels, 16 + D)."""
    field = columns.field
    first, end = field.cells[cell], field.cells[cell + 1]
    rows = np.empty((end - first, _IN_CELL + columns.dense.shape[1]))
    for m in range(first, end):
        n = field.order[m]
        row = rows[m - first]
        for i in range(4):
            along = field.along_weights[n, i] * columns.gain[n]
            for j in range(4):
                row[4 * i + j] = along * field.across_weights[n, j]
        row[_IN_CELL:] = columns.dense[n]
    return rows


@compiled_inline
def _places_and_weights(columns: DesignMatrix, cell: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """A cell's pixels, shape (pixels,), and their weights, shape (pixels, 1)."""
    field = columns.field
    places = field.order[field.cells[cell] : field.cells[cell + 1]]
    return places, columns.weight[places].reshape(-1, 1)


@compiled
def add_normal_equations(
    columns: DesignMatrix,
    first: int,
    end: int,
    target: NDArray[np.float64],
    matrix: BorderedMatrix,
    side: NDArray[np.float64],
) -> None:
    """Add A'WA and A'W target of the cells from `first` to before `end`.

    Parameters
    ----------
    target
        Shape (N,).
    matrix, side
        Results, for M + D coefficients.
    """
    for cell in range(first, end):
        index, rows = _cell_index(columns, cell), _cell_rows(columns, cell)
        places, weight = _places_and_weights(columns, cell)
        weighted = weight * rows
        block, of_target = np.dot(rows.T, weighted), np.dot(weighted.T, target[places])
        for a in range(index.shape[0]):
            side[index[a]] += of_target[a]
        for a in range(_IN_CELL):
            for b in range(a + 1):
                matrix.band[index[b], index[a] - index[b]] += block[a, b]
        for a in range(_IN_CELL, index.shape[0]):
            for b in range(_IN_CELL):
                matrix.border[a - _IN_CELL, index[b]] += block[a, b]
            for b in range(_IN_CELL, a + 1):
                matrix.corner[a - _IN_CELL, b - _IN_CELL] += block[a, b]


@compiled
def add_right_sides(
    columns: DesignMatrix, first: int, end: int, targets: NDArray[np.float64], sides: NDArray[np.float64]
) -> None:
    """Add A'W targets, targets of shape (N, T), of some of the cells to `sides`, shape (M + D, T)."""
    for cell in range(first, end):
        index, rows = _cell_index(columns, cell), _cell_rows(columns, cell)
        places, weight = _places_and_weights(columns, cell)
        block = np.dot(rows.T, weight * targets[places])
        for a in range(index.shape[0]):
            sides[index[a]] += block[a]


def normal_equations_of(
    columns: DesignMatrix, target: NDArray[np.float64], precision: float
) -> tuple[BorderedMatrix, NDArray[np.float64]]:
    """A'WA with the field's prior of a precision, for M + D coefficients, and A'W target, shape (M + D,)."""
    field, dense = columns.field, columns.dense.shape[1]
    size, width = field.size, field.roughness_band.shape[1]

    def of_part(part: slice) -> tuple[NDArray[np.float64], ...]:
        matrix, side = BorderedMatrix.of_zeros(size, width, dense), np.zeros(size + dense)
        add_normal_equations(columns, part.start, part.stop, target, matrix, side)
        return (*matrix, side)

    halves = on_both_halves(of_part, len(columns.field.cells) - 1, _LEAST_CELLS_TO_SHARE)
    band, border, corner, side = (_sum_in_place(parts) for parts in zip(*halves, strict=True))
    band += precision * field.roughness_band
    matrix = BorderedMatrix(band, border, corner)
    matrix.add_to_diagonal(_LEAST_RIDGE)
    return matrix, side


def right_sides_of(columns: DesignMatrix, targets: NDArray[np.float64]) -> NDArray[np.float64]:
    """A'W times targets, shape (N, T); the result has shape (M + D, T)."""
    total = columns.field.size + columns.dense.shape[1]

    def of_part(part: slice) -> NDArray[np.float64]:
        sides = np.zeros((total, targets.shape[1]))
        add_right_sides(columns, part.start, part.stop, targets, sides)
        return sides

    return _sum_in_place(on_both_halves(of_part, len(columns.field.cells) - 1, _LEAST_CELLS_TO_SHARE))


def _sum_in_place(parts: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Sum of arrays that are not needed any more, in the first of them."""
    total, *others = parts
    for other in others:
        total += other
    return total
