"""Hyperparameters of the distortion, against the textbook and against draws with known ones."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from services.imaging.core.distortion_field import (
    Hyperparameters,
    LinearSystem,
    RestrictedLikelihood,
    correlation,
    distances_px,
    most_likely_hyperparameters,
    polynomial,
)

Array = NDArray[np.float64]

ORDER = 2
PRIOR = Hyperparameters(ORDER, 2.0, 180.0, 1.4)


def system_of(rng: np.random.Generator, count: int = 40) -> LinearSystem:
    return LinearSystem(
        measured_px=rng.uniform(0.0, 600.0, (count, 2)),
        deviation_px=rng.uniform(0.05, 0.15, count),
        centre_px=np.array([300.0, 300.0]),
        half_size_px=300.0,
        target_px=rng.normal(0.0, 3.0, (count, 2)),
        slopes=rng.normal(0.0, 0.5, (count, 2, 3)),
        source_prior=np.array([[3.0, -2.0, 10.0], [100.0, 100.0, 150.0]]),
    )


def covariance_of(system: LinearSystem, prior: Hyperparameters) -> Array:
    distance = distances_px(system.measured_px, system.measured_px)
    noise = np.diag(np.square(prior.noise_factor * system.deviation_px))
    return np.asarray(prior.amplitude_px**2 * correlation(distance, prior.length_px) + noise)


def marginal(system: LinearSystem, prior: Hyperparameters) -> float:
    """Log-density of the targets under a very wide prior of the polynomial: the restricted one but for a constant."""
    basis = polynomial(system.measured_px, system.centre_px, system.half_size_px, prior.order)
    nothing = np.zeros_like(basis)
    linear = np.block([[basis, nothing, -system.slopes[:, 0]], [nothing, basis, -system.slopes[:, 1]]])
    wide = np.concatenate([np.full(2 * basis.shape[1], 1e4**2), system.source_prior[1] ** 2])
    mean = linear[:, -3:] @ system.source_prior[0]
    covariance = np.kron(np.eye(2), covariance_of(system, prior)) + (linear * wide) @ linear.T
    off = system.target_px.T.ravel() - mean
    return float(-0.5 * (off @ np.linalg.solve(covariance, off) + np.linalg.slogdet(covariance)[1]))


def test_likelihood_is_that_of_the_targets_with_the_linear_part_integrated_out() -> None:
    rng = np.random.default_rng(3)
    system = system_of(rng)
    system = replace(system, target_px=np.linalg.cholesky(covariance_of(system, PRIOR)) @ rng.normal(size=(40, 2)))
    likelihood = RestrictedLikelihood(system, ORDER)
    for other in (replace(PRIOR, amplitude_px=0.7), replace(PRIOR, length_px=400.0), replace(PRIOR, noise_factor=5.0)):
        wanted = marginal(system, other) - marginal(system, PRIOR)
        assert likelihood.of(other) - likelihood.of(PRIOR) == pytest.approx(wanted, abs=1e-2)


def test_the_hyperparameters_of_draws_are_found() -> None:
    found = []
    for seed in range(8):
        rng = np.random.default_rng([9, seed])
        system = system_of(rng, 90)
        root = np.linalg.cholesky(covariance_of(system, PRIOR))
        drawn = replace(system, target_px=root @ rng.normal(size=(90, 2)))
        best = most_likely_hyperparameters(drawn, Hyperparameters(ORDER, 0.5, 300.0, 1.0), 60)
        found.append(np.log([best.amplitude_px, best.length_px, best.noise_factor]))
    middle = np.exp(np.median(found, axis=0))
    assert middle == pytest.approx([PRIOR.amplitude_px, PRIOR.length_px, PRIOR.noise_factor], rel=0.25)


def test_no_covariance_is_likely_that_is_not_positive() -> None:
    system = system_of(np.random.default_rng(4))
    twice = replace(system, measured_px=np.repeat(system.measured_px[:20], 2, axis=0), deviation_px=np.zeros(40))
    assert RestrictedLikelihood(twice, ORDER).of(PRIOR) == -np.inf
