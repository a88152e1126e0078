import numpy as np
import pytest

from shared.xray.disc_kernel import BACKGROUND_TERMS, factorise, model_row, solve_cholesky

DISCS = 2


def overlapping() -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Background, contrasts, x, y, radii, overlap, blur of two discs that overlap."""
    background = [1.0, 0.2, -0.1, 0.05, 0.02, -0.03]
    return np.array([*background, 1.5, 1.2, 10.0, 14.0, 9.5, 11.0, 5.0, 3.5, 0.8, 1.4])


@pytest.mark.parametrize("place", [(12.0, 10.5), (8.0, 7.0), (16.0, 12.0), (25.0, 3.0)])
def test_derivatives_are_those_of_the_model(place: tuple[float, float]) -> None:
    frame = np.array([12.0, 10.0, 15.0])
    p = overlapping()
    row, scratch = np.empty(len(p)), np.empty(len(p))
    model_row(*place, frame, p, DISCS, row)
    step = 1e-6
    for i in range(len(p)):
        more, less = p.copy(), p.copy()
        more[i] += step
        less[i] -= step
        up = model_row(*place, frame, more, DISCS, scratch)
        down = model_row(*place, frame, less, DISCS, scratch)
        assert row[i] == pytest.approx((up - down) / (2.0 * step), abs=1e-6), f"parameter {i}"


def test_under_both_discs_it_is_darker_than_under_one_but_not_by_the_sum() -> None:
    frame = np.array([12.0, 10.0, 15.0])
    p = overlapping()
    scratch = np.empty(len(p))

    def shade(contrasts: tuple[float, float]) -> float:
        q = p.copy()
        q[BACKGROUND_TERMS : BACKGROUND_TERMS + DISCS] = contrasts
        bright = p.copy()
        bright[BACKGROUND_TERMS : BACKGROUND_TERMS + DISCS] = 0.0
        at = (12.3, 10.4)
        return float(model_row(*at, frame, bright, DISCS, scratch) - model_row(*at, frame, q, DISCS, scratch))

    first, second, both = shade((1.5, 0.0)), shade((0.0, 1.2)), shade((1.5, 1.2))
    assert max(first, second) < both < first + second - 0.2


def test_the_solver_solves_and_refuses_what_is_not_positive() -> None:
    rng = np.random.default_rng(1)
    root = rng.normal(size=(6, 6))
    normal, wanted = root @ root.T + np.eye(6), rng.normal(size=6)
    step = np.zeros(6)
    assert solve_cholesky(np.tril(normal), normal @ wanted, 0.0, step)
    assert step == pytest.approx(wanted)
    assert not factorise(-np.eye(3))
