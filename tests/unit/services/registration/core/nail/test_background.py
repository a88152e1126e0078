"""The background field: what it can follow, what its prior resists, and its normal equations."""

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.nail.background import (
    BorderedMatrix,
    DesignMatrix,
    SplineField,
    add_normal_equations,
    add_right_sides,
    cholesky_factor,
    lower_band,
    spline_field,
)


def field_at(count: int, seed: int) -> SplineField:
    rng = np.random.default_rng(seed)
    return spline_field(rng.uniform(-20.0, 20.0, count), rng.uniform(-8.0, 8.0, count), 3.0)


def basis_matrix(field: SplineField) -> NDArray[np.float64]:
    return np.column_stack([field.at_places(column) for column in np.eye(field.size)])


def whole(matrix: BorderedMatrix) -> NDArray[np.float64]:
    """Lower triangle of the full matrix."""
    size, width = matrix.band.shape
    out = np.zeros((size + len(matrix.corner), size + len(matrix.corner)))
    for k in range(width):
        for m in range(size - k):
            out[m + k, m] = matrix.band[m, k]
    out[size:, :size], out[size:, size:] = matrix.border, np.tril(matrix.corner)
    return out


def test_equal_coefficients_are_a_constant() -> None:
    field = field_at(200, 1)
    assert np.abs(field.at_places(np.full(field.size, 2.5)) - 2.5).max() < 1e-12


def test_planes_have_no_roughness_and_bumps_have() -> None:
    field = field_at(50, 2)
    along, across = np.meshgrid(np.arange(field.grid[0]), np.arange(field.grid[1]), indexing="ij")
    plane = (1.0 + 0.3 * along - 0.7 * across).ravel()
    bump = np.zeros(field.size)
    bump[field.size // 2] = 1.0
    assert abs(plane @ field.roughness @ plane) < 1e-9
    assert bump @ field.roughness @ bump > 5.0


def test_where_the_field_is_less_stiff_bumps_cost_less_and_planes_still_nothing() -> None:
    def soft_ahead(along_mm: NDArray[np.float64], across_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.where(along_mm + 0.0 * across_mm > 0.0, 0.01, 1.0)

    rng = np.random.default_rng(2)
    places = rng.uniform(-20.0, 20.0, 400), rng.uniform(-8.0, 8.0, 400)
    even, soft = spline_field(*places, 3.0), spline_field(*places, 3.0, soft_ahead)
    along, across = np.meshgrid(*(np.arange(count) for count in soft.grid), indexing="ij")
    plane = (1.0 + 0.3 * along - 0.7 * across).ravel()
    assert abs(plane @ soft.roughness @ plane) < 1e-9
    behind, ahead = np.zeros((2, soft.size))
    behind[3 * soft.grid[1] + 4], ahead[-3 * soft.grid[1] - 4] = 1.0, 1.0
    assert behind @ soft.roughness @ behind == pytest.approx(behind @ even.roughness @ behind)
    assert ahead @ soft.roughness @ ahead == pytest.approx(0.01 * (ahead @ even.roughness @ ahead))
    dense = whole(BorderedMatrix(soft.roughness_band, np.zeros((0, soft.size)), np.zeros((0, 0))))
    np.testing.assert_allclose(dense, np.tril(soft.roughness))


def test_determinants_are_those_of_the_dense_matrices() -> None:
    field, other = field_at(50, 2), field_at(50, 2)
    ridge = 1e-9 * np.eye(field.size)
    expected = np.linalg.slogdet(7.0 * (field.roughness + ridge))[1]
    assert other.log_prior_determinant(7.0) == pytest.approx(expected, rel=1e-6)
    band = lower_band(field.roughness + np.eye(field.size), field.roughness_band.shape[1])
    matrix = BorderedMatrix(band, np.full((1, field.size), 0.1), np.array([[9.0]]))
    full = whole(matrix)
    expected = np.linalg.slogdet(full + np.tril(full, -1).T)[1]
    assert cholesky_factor(matrix).log_determinant == pytest.approx(expected)


def test_normal_equations_are_those_of_the_dense_matrix() -> None:
    rng = np.random.default_rng(3)
    field = field_at(300, 3)
    gain, weight, targets = rng.uniform(0.0, 1.0, 300), rng.uniform(0.5, 2.0, 300), rng.normal(size=(300, 2))
    dense = rng.normal(size=(300, 3))
    total, target = field.size + 3, rng.normal(size=300)
    matrix = BorderedMatrix.of_zeros(field.size, field.roughness_band.shape[1], 3)
    right, side = np.zeros((total, 2)), np.zeros(total)
    of_field, cells = DesignMatrix(field, gain, dense, weight), len(field.cells) - 1
    for first, end in ((0, cells // 3), (cells // 3, cells)):
        add_normal_equations(of_field, first, end, target, matrix, side)
        add_right_sides(of_field, first, end, targets, right)
    columns = np.column_stack([gain[:, None] * basis_matrix(field), dense])
    expected = columns.T @ (weight[:, None] * columns)
    assert np.abs(np.tril(whole(matrix)) - np.tril(expected)).max() < 1e-9
    assert np.abs(side - columns.T @ (weight * target)).max() < 1e-9
    assert np.abs(right - columns.T @ (weight[:, None] * targets)).max() < 1e-9


def test_a_bordered_matrix_is_solved_like_the_full_one() -> None:
    rng = np.random.default_rng(4)
    field = field_at(300, 4)
    columns = np.column_stack([rng.uniform(0.0, 1.0, (300, 1)) * basis_matrix(field), rng.normal(size=(300, 3))])
    size, width = field.size, field.roughness_band.shape[1]
    full = columns.T @ columns
    full[:size, :size] += 0.1 * field.roughness
    full[np.diag_indices(size + 3)] += 1e-3 * np.trace(full) / (size + 3)
    block = columns.T @ columns
    matrix = BorderedMatrix(
        lower_band(block[:size, :size], width) + 0.1 * field.roughness_band, block[size:, :size], block[size:, size:]
    )
    matrix.add_to_diagonal(1e-3)
    assert np.abs(np.tril(whole(matrix)) - np.tril(full)).max() < 1e-9
    sides = rng.normal(size=(size + 3, 4))
    factor = cholesky_factor(matrix)
    assert np.abs(full @ factor.solved(sides) - sides).max() < 1e-8
    assert np.array_equal(factor.solved(sides[:, 0]), factor.solved(sides[:, :1])[:, 0])


def test_columns_that_the_field_can_follow_are_solved_for_all_the_same() -> None:
    """Where all pixels see as much of the background, a level floor is a level background."""
    field = field_at(2000, 5)
    columns = DesignMatrix(field, np.full(2000, 0.5), np.full((2000, 1), 0.5), np.full(2000, 1.0e4))
    matrix, side = BorderedMatrix.of_zeros(field.size, field.roughness_band.shape[1], 1), np.zeros(field.size + 1)
    add_normal_equations(columns, 0, len(field.cells) - 1, np.ones(2000), matrix, side)
    matrix.band[:] += 1.0e4 * field.roughness_band
    matrix.add_to_diagonal(1e-9)
    solution = cholesky_factor(matrix).solved(side)
    assert np.abs(0.5 * field.at_places(solution[:-1]) + 0.5 * solution[-1] - 1.0).max() < 1e-3
