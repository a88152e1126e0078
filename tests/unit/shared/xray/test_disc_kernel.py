import math

import numpy as np
import pytest
from numpy.typing import NDArray

from shared.xray.disc_kernel import factorise, normal_equations, solve_cholesky
from shared.xray.disc_model import BACKGROUND_TERMS, edge, model_rows

Array = NDArray[np.float64]

DISCS = 2
FRAME = np.array([12.0, 10.0, 15.0])


def overlapping() -> Array:
    """Background, contrasts, x, y, radii, overlap, blur of two discs that overlap."""
    background = [1.0, 0.2, -0.1, 0.05, 0.02, -0.03]
    return np.array([*background, 1.5, 1.2, 10.0, 14.0, 9.5, 11.0, 5.0, 3.5, 0.8, 1.4])


def modelled(p: Array, places: list[tuple[float, float]]) -> tuple[Array, Array]:
    samples = np.array([[x, y, 0.0] for x, y in places])
    rows, grey = np.empty((len(p), len(samples))), np.empty(len(samples))
    model_rows(samples, FRAME, p, DISCS, 0.8, rows, grey)
    return grey, rows


def test_derivatives_are_those_of_the_model() -> None:
    places = [(12.0, 10.5), (8.0, 7.0), (16.0, 12.0), (25.0, 3.0)]
    p = overlapping()
    _, rows = modelled(p, places)
    step = 1e-4  # the error function is good to 1.5e-7
    for i in range(len(p)):
        more, less = p.copy(), p.copy()
        more[i] += step
        less[i] -= step
        slope = (modelled(more, places)[0] - modelled(less, places)[0]) / (2.0 * step)
        assert rows[i] == pytest.approx(slope, abs=3e-4), f"parameter {i}"


def test_under_both_discs_it_is_darker_than_under_one_but_not_by_the_sum() -> None:
    p = overlapping()

    def shade(contrasts: tuple[float, float]) -> float:
        q, bright = p.copy(), p.copy()
        q[BACKGROUND_TERMS : BACKGROUND_TERMS + DISCS] = contrasts
        bright[BACKGROUND_TERMS : BACKGROUND_TERMS + DISCS] = 0.0
        at = [(12.3, 10.4)]
        return float((modelled(bright, at)[0] - modelled(q, at)[0])[0])

    first, second, both = shade((1.5, 0.0)), shade((0.0, 1.2)), shade((1.5, 1.2))
    assert max(first, second) < both < first + second - 0.2


@pytest.mark.parametrize("z", [-6.0, -1.3, -0.2, 0.0, 0.4, 2.2, 7.0])
def test_an_edge_is_a_blurred_step(z: float) -> None:
    assert edge(z, math.exp(-0.5 * z * z)) == pytest.approx(0.5 * math.erfc(z / math.sqrt(2.0)), abs=2e-7)


def test_normal_equations_are_the_weighted_products() -> None:
    rng = np.random.default_rng(2)
    rows, residual, weight = rng.normal(size=(5, 40)), rng.normal(size=40), rng.uniform(0.1, 2.0, 40)
    normal, gradient = np.zeros((5, 5)), np.zeros(5)
    cost = normal_equations(rows, residual, weight, normal, gradient)
    assert cost == pytest.approx((weight * residual**2).sum())
    assert gradient == pytest.approx(rows @ (weight * residual))
    assert np.tril(normal) == pytest.approx(np.tril((rows * weight) @ rows.T))


def test_the_solver_solves_and_refuses_what_is_not_positive() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(6, 6))
    normal, wanted = root @ root.T + np.eye(6), rng.normal(size=6)
    step = np.zeros(6)
    assert solve_cholesky(np.tril(normal), normal @ wanted, 0.0, step)
    assert step == pytest.approx(wanted)
    assert not factorise(-np.eye(3))
