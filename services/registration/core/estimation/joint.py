"""Several estimates of one pose: their mean, its covariance under shared errors, and whether they agree.

What an image contributes, a pose and the deviations of the nail's shape, stands one after the other for all images:
6 + S numbers each, in the order of `PoseErrors`.

Images of one nail share its shape. Holes that are wider than estimated have tilted the nail one way in an image from
one side, and the other way in an image from the other: that both show the same holes separates their width from a
tilt, and the weights make use of it. For the rest the weights take the images as independent, but for counting each the
less the more others were taken from its direction; the covariance of the result does not:

- what comes with an image (guide's balls, calibration, the nail's fit) is noise, which is new every time, and things
  that images from the same direction share, such as the bone's texture: the correlation falls with the angle between
  the directions;
- the model's own errors are mostly the same in all images, so that they hardly average out.

These two correlations are about those that set-ups showed that were observed several times
(`docs/benchmarks/fusion.md`).
"""

from dataclasses import dataclass, replace
from typing import Generic

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from services.registration.core.estimation.pose_estimate import (
    POSE_SIZE,
    From,
    PoseErrors,
    PoseEstimate,
    To,
    with_bend,
)
from services.registration.core.tuning import SHARED_ERRORS
from shared.geometry.lines import angle_between_rad, read_only
from shared.geometry.transform import Transform

# Numerical guards: the last step is far below any standard deviation.
_ITERATIONS = 10
_CONVERGED = 1e-10
# Numerical guards. Of a deviation, in its standard deviations: one that an image does not determine has no noise.
_LEAST_SHAPE_VARIANCE = 1e-6
# An estimated deviation follows the true one by at least this share if the image determines it at all.
_LEAST_RESPONSE = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class JointEstimate(Generic[To, From]):
    """The joint estimate of several."""

    pose: PoseEstimate[To, From]  # with its covariance
    weights: NDArray[np.float64]  # how the error of each pose enters the joint one, shape (K, 6, 6)
    # sum of squares of the estimates, of poses and of the nail's shape, about their mean, over their covariance: as
    # large, on average, as its degrees of freedom if nothing has moved
    chi_square: float
    degrees_of_freedom: int
    curvature_per_m: tuple[float, float] = (0.0, 0.0)  # of the nail towards its y and z
    # Of the pose and the curvature, shape (8, 8); None for weights that estimate no curvature
    covariance_with_bend: NDArray[np.float64] | None = None


def fuse(estimates: tuple[PoseEstimate[To, From], ...]) -> JointEstimate[To, From]:
    """Weighted mean of one or more estimates.

    A nail that is bent in one image is bent in all: each image that took it as straight is off by what the curvature
    does to its fit. Where no image shows a curvature the nail stays straight.
    """
    bend_sd = max(one.errors.bend_sd_per_m for one in estimates)
    estimates = tuple(replace(one, errors=one.errors.with_bend_in(bend_sd)) for one in estimates)
    errors = tuple(one.errors for one in estimates)
    weights = _all_weights(errors)
    if not any(one.curvature_per_m.any() for one in errors) and bend_sd > 0.0:
        weights[:, -2:] = 0.0
    covariance = covariance_of_mean(errors, weights)
    joint = fused_by(estimates, weights[:, :POSE_SIZE], covariance[:POSE_SIZE, :POSE_SIZE])
    departures = _departures(estimates, joint.pose.mean)
    observed = np.hstack([departures, np.stack([one.shape_deviations for one in errors])])
    y, z = (bend_sd * np.einsum("kij,kj->i", weights, observed)[-2:]).tolist()
    return replace(joint, curvature_per_m=(y, z), covariance_with_bend=with_bend(covariance, bend_sd))


def fused_by(
    estimates: tuple[PoseEstimate[To, From], ...], weights: NDArray[np.float64], covariance: NDArray[np.float64]
) -> JointEstimate[To, From]:
    """The mean by weights, shape (K, 6, 6 + S), that has the covariance, shape (6, 6)."""
    of_poses, of_shapes = weights[:, :, :POSE_SIZE], weights[:, :, POSE_SIZE:]
    by_shape = np.einsum("kis,ks->i", of_shapes, np.stack([one.errors.shape_deviations for one in estimates]))
    mean = estimates[0].mean
    for _ in range(_ITERATIONS):
        step = by_shape + np.einsum("kij,kj->i", of_poses, _departures(estimates, mean))
        mean = mean.moved(step)
        if float(np.abs(step).max()) < _CONVERGED:
            break
    chi_square, freedom = _disagreement(tuple(one.errors for one in estimates), _departures(estimates, mean))
    return JointEstimate(PoseEstimate.of(mean, covariance), read_only(of_poses), chi_square, freedom)


def leave_one_out(estimates: tuple[PoseEstimate[To, From], ...]) -> NDArray[np.float64]:
    """By how much chi-square falls when one estimate is left out, for each, shape (K,): 9 on average."""
    whole = fuse(estimates).chi_square
    return np.array([whole - fuse(estimates[:k] + estimates[k + 1 :]).chi_square for k in range(len(estimates))])


def _all_weights(errors: tuple[PoseErrors, ...]) -> NDArray[np.float64]:
    """How each estimate enters the joint pose and shape, shape (K, 6 + S, 6 + S).

    Least squares for one pose and one shape, with the prior of the nail's file. One image alone has made use of the
    prior already.
    """
    size = len(errors[0].own_covariance)
    if len(errors) == 1:
        return np.eye(size)[None]
    means = responses(errors)
    information = np.linalg.solve(block_diag(*_counted_covariances(errors)), means).T
    precision = information @ means
    precision[POSE_SIZE:, POSE_SIZE:] += np.eye(size - POSE_SIZE)
    weights = np.linalg.solve(precision, information)
    return np.array(weights.reshape(size, len(errors), size).transpose(1, 0, 2))


def responses(errors: tuple[PoseErrors, ...]) -> NDArray[np.float64]:
    """How the estimates follow the true pose and shape, shape (K (6 + S), 6 + S)."""
    by_pulls = [np.hstack([np.zeros((len(one.shape_pull), POSE_SIZE)), one.shape_pull]) for one in errors]
    return np.concatenate([np.eye(len(by_pull)) - by_pull for by_pull in by_pulls])


def covariance_of_mean(errors: tuple[PoseErrors, ...], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance, shape (R, R), of the pose, or pose and shape, that estimates enter by `weights`, (K, R, 6 + S)."""
    side_by_side = np.hstack(list(weights))
    by_shape = (side_by_side @ responses(errors))[:, POSE_SIZE:]
    by_shape[POSE_SIZE:] -= np.eye(by_shape.shape[1])[: len(by_shape) - POSE_SIZE]
    return np.asarray(side_by_side @ joint_covariance(errors) @ side_by_side.T + by_shape @ by_shape.T)


def joint_covariance(errors: tuple[PoseErrors, ...]) -> NDArray[np.float64]:
    """Covariance of the errors of all estimates by all but the nail's shape, shape (K (6 + S), K (6 + S))."""
    roots = [_root(one.image_covariance) for one in errors]
    covariance = block_diag(*(one.own_covariance for one in errors))
    size = len(roots[0])
    for k, first in enumerate(errors):
        for m, second in enumerate(errors[:k]):
            shared = image_correlation(first, second) * roots[k] @ roots[m].T
            shared += SHARED_ERRORS.of_the_model * first.model_loadings @ second.model_loadings.T
            rows, columns = slice(size * k, size * (k + 1)), slice(size * m, size * (m + 1))
            covariance[rows, columns] = shared
            covariance[columns, rows] = shared.T
    return covariance


def image_correlation(first: PoseErrors, second: PoseErrors) -> float:
    """Correlation of the errors that come with two images; 0 where they do not depend on the direction."""
    if first.ray is None or second.ray is None:
        return 0.0
    apart_deg = float(np.degrees(angle_between_rad(first.ray, second.ray)))
    return float(SHARED_ERRORS.from_one_direction * np.exp(-0.5 * (apart_deg / SHARED_ERRORS.within_deg) ** 2))


def _departures(estimates: tuple[PoseEstimate[To, From], ...], mean: Transform[To, From]) -> NDArray[np.float64]:
    return np.stack([mean.motion_to(one.mean) for one in estimates])


def _disagreement(errors: tuple[PoseErrors, ...], departures: NDArray[np.float64]) -> tuple[float, int]:
    """Chi-square of the estimates about one pose and one shape for all, and its degrees of freedom.

    The shape belongs in it because it moves the joint pose: images that find the guide in the same place and the nail's
    holes of different width contradict one another. What an image does not determine of the shape does not count.

    The departures of the poses are those from one that is close to all, shape (K, 6).
    """
    observed = np.hstack([departures, np.stack([one.shape_deviations for one in errors])]).ravel()
    means = responses(errors)
    size = means.shape[1]
    places = np.arange(len(means)) % size
    determined = (places < POSE_SIZE) | (means[np.arange(len(means)), places] > _LEAST_RESPONSE)
    known = np.unique(places[determined])
    precision = np.linalg.inv(block_diag(*(one.own_covariance for one in errors))[np.ix_(determined, determined)])
    means, observed = means[np.ix_(determined, known)], observed[determined]
    left = observed - means @ np.linalg.solve(means.T @ precision @ means, means.T @ precision @ observed)
    return float(left @ precision @ left), int(np.count_nonzero(determined)) - len(known)


def _counted_covariances(errors: tuple[PoseErrors, ...]) -> list[NDArray[np.float64]]:
    """Of each image, larger for those that share errors with others: many from one place count little more than one.

    A poor image from its side makes a good one count less, too; the covariance of the result takes it into account.
    """
    counted = []
    for k, one in enumerate(errors):
        shared = sum(image_correlation(one, other) for m, other in enumerate(errors) if m != k)
        covariance = (1.0 + shared) * one.own_covariance
        covariance[POSE_SIZE:, POSE_SIZE:] += _LEAST_SHAPE_VARIANCE * np.eye(len(covariance) - POSE_SIZE)
        counted.append(covariance)
    return counted


def _root(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Symmetric root of the correlations, times the standard deviations: the same whatever the units are."""
    deviations = np.sqrt(np.diag(covariance))
    scale = np.where(deviations > 0.0, deviations, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(deviations[:, None] * ((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T))
