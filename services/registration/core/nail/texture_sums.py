"""Normal equations of the background's coefficients: sums over pixels, cell by cell, as products of small matrices."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from services.registration.core.compiled import compiled
from services.registration.core.nail.bordered import BorderedMatrix
from services.registration.core.nail.texture import SplineField

_IN_CELL = 16


class Columns(NamedTuple):
    """The columns A = [gain * spline basis, dense] and the weights W of N pixels.

    Attributes
    ----------
    order, cells, corner, along_weights, across_weights
        Of the `SplineField`.
    coefficients, count_across
        Number of its coefficients, in all and across.
    gain, weight
        Shape (N,).
    dense
        Columns that act everywhere, shape (N, D).
    """

    order: NDArray[np.int64]
    cells: NDArray[np.int64]
    corner: NDArray[np.int64]
    along_weights: NDArray[np.float64]
    across_weights: NDArray[np.float64]
    coefficients: int
    count_across: int
    gain: NDArray[np.float64]
    dense: NDArray[np.float64]
    weight: NDArray[np.float64]


def columns_of(
    field: SplineField, gain: NDArray[np.float64], dense: NDArray[np.float64], weight: NDArray[np.float64]
) -> Columns:
    """Columns of a field that is seen with some gain, and of what acts everywhere."""
    weights = (field.along_weights, field.across_weights)
    return Columns(field.order, field.cells, field.corner, *weights, field.size, field.grid[1], gain, dense, weight)


@compiled
def _cell_index(columns: Columns, cell: int) -> NDArray[np.int64]:
    """Which of all coefficients the pixels of a cell depend on, increasing, shape (16 + D,)."""
    dense = columns.dense.shape[1]
    index = np.empty(_IN_CELL + dense, dtype=np.int64)
    first = columns.corner[columns.order[columns.cells[cell]]]
    for i in range(4):
        index[4 * i : 4 * i + 4] = first + i * columns.count_across + np.arange(4)
    index[_IN_CELL:] = columns.coefficients + np.arange(dense)
    return index


@compiled
def _cell_rows(columns: Columns, cell: int) -> NDArray[np.float64]:
    """What is not zero of A in the rows of a cell's pixels, shape (pixels, 16 + D)."""
    first, end = columns.cells[cell], columns.cells[cell + 1]
    rows = np.empty((end - first, _IN_CELL + columns.dense.shape[1]))
    for m in range(first, end):
        n = columns.order[m]
        row = rows[m - first]
        for i in range(4):
            along = columns.along_weights[n, i] * columns.gain[n]
            for j in range(4):
                row[4 * i + j] = along * columns.across_weights[n, j]
        row[_IN_CELL:] = columns.dense[n]
    return rows


@compiled
def _places_and_weights(columns: Columns, cell: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """A cell's pixels, shape (pixels,), and their weights, shape (pixels, 1)."""
    places = columns.order[columns.cells[cell] : columns.cells[cell + 1]]
    return places, columns.weight[places].reshape(-1, 1)


@compiled
def add_normal_equations(
    columns: Columns,
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
    columns: Columns, first: int, end: int, targets: NDArray[np.float64], sides: NDArray[np.float64]
) -> None:
    """Add A'W targets, targets of shape (N, T), of some of the cells to `sides`, shape (M + D, T)."""
    for cell in range(first, end):
        index, rows = _cell_index(columns, cell), _cell_rows(columns, cell)
        places, weight = _places_and_weights(columns, cell)
        block = np.dot(rows.T, weight * targets[places])
        for a in range(index.shape[0]):
            sides[index[a]] += block[a]
