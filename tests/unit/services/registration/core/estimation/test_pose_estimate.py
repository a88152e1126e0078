"""Errors carried along chains of estimates, and the mean of two estimates of one pose."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from services.registration.core.estimation.pose_estimate import PoseErrors, PoseEstimate, condition, weighted_mean
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.transform import Transform

PREDICTED: Transform[Camera, Nail] = Transform.from_rotvec([0.05, -0.02, 0.6], [3.0, -4.0, 700.0])
SEEN = PREDICTED.moved([0.01, 0.004, -0.002, 0.2, -0.1, 1.0])
ONE = np.diag([1e-5, 1e-5, 1e-6, 0.01, 0.01, 1.0])


def mean_of(
    predicted_covariance: NDArray[np.float64], seen_covariance: NDArray[np.float64]
) -> tuple[Transform[Camera, Nail], NDArray[np.float64]]:
    first, second = PoseEstimate.of(PREDICTED, predicted_covariance), PoseEstimate.of(SEEN, seen_covariance)
    joint = weighted_mean(first, second, 0.5)
    return joint.mean, joint.covariance


def turn_deg(a: Transform[Camera, Nail], b: Transform[Camera, Nail]) -> float:
    return float(np.degrees(np.linalg.norm((a.inverse() @ b).rotation_vector_rad)))


def test_the_more_certain_of_two_prevails() -> None:
    pose, covariance = mean_of(1e-6 * ONE, ONE)
    assert turn_deg(pose, PREDICTED) < 1e-4
    assert np.allclose(covariance, 1e-6 * ONE, rtol=0.01)
    pose, covariance = mean_of(ONE, 1e-6 * ONE)
    assert turn_deg(pose, SEEN) < 1e-4
    assert np.allclose(covariance, 1e-6 * ONE, rtol=0.01)


def test_equal_ones_meet_in_the_middle_with_more_variance_than_independent_ones_would_have() -> None:
    pose, covariance = mean_of(ONE, ONE)
    assert turn_deg(pose, PREDICTED) == pytest.approx(0.5 * turn_deg(SEEN, PREDICTED), rel=1e-6)
    # half the variance if independent, all of it if the same: three quarters with a correlation of one half
    assert np.allclose(covariance, 0.75 * ONE)


def test_errors_of_a_chain_are_those_of_its_links_seen_from_its_end() -> None:
    """Draw errors of guide and nail: `guide_from_nail` scatters as the product of the estimates predicts."""
    camera_from_guide: Transform[Camera, Guide] = Transform.from_rotvec([0.0, 0.1, 0.3], [5.0, -2.0, 630.0])
    camera_from_nail: Transform[Camera, Nail] = Transform.from_rotvec([0.05, 0.02, 0.5], [7.0, -4.0, 737.0])
    of_guide = np.diag([1e-4, 2e-4, 1e-4, 0.01, 0.02, 0.05]) ** 2
    of_nail = np.diag([2e-4, 1e-4, 1e-4, 0.02, 0.01, 0.2]) ** 2
    chained = PoseEstimate.of(camera_from_guide, of_guide).inverse() @ PoseEstimate.of(camera_from_nail, of_nail)
    rng, drawn = np.random.default_rng(3), []
    for by_guide, by_nail in rng.standard_normal((4000, 2, 6)):
        guide = camera_from_guide.moved(np.sqrt(np.diag(of_guide)) * by_guide)
        nail = camera_from_nail.moved(np.sqrt(np.diag(of_nail)) * by_nail)
        drawn.append(chained.mean.motion_to(guide.inverse() @ nail))
    deviation = np.sqrt(np.diag(chained.covariance))
    difference = (np.cov(np.array(drawn).T) - chained.covariance) / np.outer(deviation, deviation)
    assert np.abs(difference).max() < 0.1


def test_a_chain_keeps_the_shared_factors_of_its_last_link() -> None:
    size, ray = 7, np.array([0.0, 0.6, 0.8])
    errors = PoseErrors(np.array([0.3]), np.eye(size) * 1e-4, np.full((size, 1), 0.01), np.ones((size, 2)) * 1e-3, ray)
    nail = PoseEstimate(PREDICTED, errors)
    guide: Transform[Guide, Camera] = Transform.from_rotvec([0.0, 0.1, 0.3], [5.0, -2.0, -640.0])
    chained = PoseEstimate.of(guide, np.zeros((6, 6))) @ nail
    assert chained.covariance == pytest.approx(nail.covariance)
    assert chained.errors.model_loadings == pytest.approx(errors.model_loadings)
    assert chained.errors.ray == pytest.approx(ray)
    assert (PoseEstimate.of(guide, ONE) @ nail).covariance[3, 3] > nail.covariance[3, 3]


def test_another_estimate_counts_as_one_standard_deviation_of_pose_and_curvature() -> None:
    errors = PoseErrors(np.zeros(2), np.zeros((8, 8)), np.zeros((8, 2)), np.zeros((8, 0)), bend_sd_per_m=2.0)
    motion, curvature = np.array([0.01, -0.02, 0.0, 0.1, 0.2, 0.3]), np.array([0.0, 0.6])
    away = np.concatenate([motion, curvature])
    assert errors.with_alternative(motion, curvature).covariance_with_bend == pytest.approx(np.outer(away, away))


def test_errors_conditioned_on_an_observation_are_those_of_least_squares() -> None:
    rng = np.random.default_rng(6)
    root, jacobian = rng.standard_normal((4, 4)), rng.standard_normal((3, 4))
    prior, noise, observed = root @ root.T, np.diag([0.1, 0.2, 0.3]), rng.standard_normal(3)
    found = condition(prior, observed, jacobian, noise)
    precision = np.linalg.inv(prior) + jacobian.T @ np.linalg.inv(noise) @ jacobian
    assert found.covariance == pytest.approx(np.linalg.inv(precision))
    assert found.mean == pytest.approx(np.linalg.solve(precision, jacobian.T @ np.linalg.solve(noise, observed)))
    left = observed - jacobian @ found.mean
    squares = left @ np.linalg.solve(noise, left) + found.mean @ np.linalg.solve(prior, found.mean)
    assert found.chi_square == pytest.approx(float(squares))


def test_errors_of_the_wrong_size_are_refused() -> None:
    with pytest.raises(ValueError, match=r"expected a covariance of shape \(7, 7\)"):
        PoseErrors(np.zeros(1), np.eye(6), np.zeros((7, 1)), np.zeros((7, 0)))


STEP = 1e-5


def numerical_derivative(motion_after: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> NDArray[np.float64]:
    """Central differences of a motion, shape (6,), by an error of shape (6,): shape (6, 6)."""
    columns = [(motion_after(STEP * d) - motion_after(-STEP * d)) / (2.0 * STEP) for d in np.eye(6)]
    return np.stack(columns, axis=1)


def full_covariance(seed: int) -> NDArray[np.float64]:
    root = np.random.default_rng(seed).standard_normal((6, 6))
    return np.asarray(root @ root.T)


def test_the_inverse_transports_errors_by_its_derivative() -> None:
    estimate = PoseEstimate.of(SEEN, full_covariance(1))
    inverse = estimate.inverse()
    J = numerical_derivative(lambda error: inverse.mean.motion_to(estimate.mean.moved(error).inverse()))
    np.testing.assert_allclose(inverse.covariance, J @ estimate.covariance @ J.T, rtol=1e-6, atol=1e-4)


def test_a_product_transports_the_errors_of_both_factors_by_its_derivatives() -> None:
    camera_from_guide: Transform[Camera, Guide] = Transform.from_rotvec([0.4, -0.1, 1.3], [5.0, -2.0, 63.0])
    guide_from_nail: Transform[Guide, Nail] = Transform.from_rotvec([0.2, 0.9, -0.5], [7.0, -40.0, 17.0])
    left, right = (
        PoseEstimate.of(camera_from_guide, full_covariance(2)),
        PoseEstimate.of(guide_from_nail, full_covariance(3)),
    )
    product = left @ right
    by_left = numerical_derivative(lambda error: product.mean.motion_to(left.mean.moved(error) @ right.mean))
    by_right = numerical_derivative(lambda error: product.mean.motion_to(left.mean @ right.mean.moved(error)))
    expected = by_left @ left.covariance @ by_left.T + by_right @ right.covariance @ by_right.T
    np.testing.assert_allclose(product.covariance, expected, rtol=1e-6, atol=1e-4)
