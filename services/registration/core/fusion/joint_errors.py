"""Errors of several images of one nail together: what they share, and how it is best to weigh the images.

What an image says, its pose and the deviations of the nail's shape, stands one after the other for all images: 6 + S
numbers each, in the order of `PoseErrors`.

Images of one nail share its shape. Holes that are wider than was found have leant the nail one way in an image from one
side, and the other way in an image from the other: that both have seen the same holes tells their width from a tilt,
and the weights make use of it. For the rest they take the images as independent, but for counting each the less the
more others were taken from its direction; the covariance of what follows does not:

- what comes with an image (guide's balls, calibration, the nail's fit) is noise, which is new every time, and things
  that images from the same direction share, such as the bone's texture: the correlation falls with the angle between
  the directions;
- the model's own errors are mostly the same in all images, so that they hardly average out.

These two correlations are about those that set-ups showed that were seen several times (`docs/benchmarks/fusion.md`).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from services.registration.core.nail.parameters import POSE_SIZE
from services.registration.core.pose_errors import PoseErrors
from services.registration.core.pose_evidence import PoseEvidence
from shared.geometry.lines import angle_between_rad

SHARED_FROM_ONE_DIRECTION = 0.7
SHARED_WITHIN_DEG = 3.0
SHARED_BY_THE_MODEL = 0.5
# Of a deviation, in its standard deviations: one that an image tells nothing of has no noise either.
_LEAST_SHAPE_VARIANCE = 1e-6
# What a fit finds of a deviation follows the true one by at least this share if it tells anything of it.
_LEAST_RESPONSE = 0.01


def weights_of(evidence: tuple[PoseEvidence, ...]) -> NDArray[np.float64]:
    """How what each image says enters the joint pose, shape (K, 6, 6 + S).

    Least squares for one pose and one shape, of which is known what the nail's file says. One image alone has made use
    of that already.
    """
    size = len(evidence[0].errors.own_covariance)
    if len(evidence) == 1:
        return np.eye(size)[None, :POSE_SIZE]
    means = responses(evidence)
    information = np.linalg.solve(block_diag(*_counted_covariances(evidence)), means).T
    precision = information @ means
    precision[POSE_SIZE:, POSE_SIZE:] += np.eye(size - POSE_SIZE)
    weights = np.linalg.solve(precision, information)[:POSE_SIZE]
    return np.asarray(weights.reshape(POSE_SIZE, len(evidence), size).transpose(1, 0, 2))


def responses(evidence: tuple[PoseEvidence, ...]) -> NDArray[np.float64]:
    """How what the images say follows the true pose and shape, shape (K (6 + S), 6 + S)."""
    return np.concatenate([_response(one.errors) for one in evidence])


def covariance_of_mean(evidence: tuple[PoseEvidence, ...], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance of a pose that images enter by `weights`, shape (K, 6, 6 + S); the result has shape (6, 6)."""
    side_by_side = np.hstack(list(weights))
    by_shape = (side_by_side @ responses(evidence))[:, POSE_SIZE:]
    return np.asarray(side_by_side @ joint_covariance(evidence) @ side_by_side.T + by_shape @ by_shape.T)


def joint_covariance(evidence: tuple[PoseEvidence, ...]) -> NDArray[np.float64]:
    """Covariance of the errors of all images by all but the nail's shape, shape (K (6 + S), K (6 + S))."""
    roots = [_root(one.errors.image_covariance) for one in evidence]
    covariance = block_diag(*(one.errors.own_covariance for one in evidence))
    size = len(roots[0])
    for k, first in enumerate(evidence):
        for m, second in enumerate(evidence[:k]):
            shared = image_correlation(first, second) * roots[k] @ roots[m].T
            shared += SHARED_BY_THE_MODEL * first.errors.model_loadings @ second.errors.model_loadings.T
            rows, columns = slice(size * k, size * (k + 1)), slice(size * m, size * (m + 1))
            covariance[rows, columns] = shared
            covariance[columns, rows] = shared.T
    return covariance


def disagreement_of(evidence: tuple[PoseEvidence, ...], departures: NDArray[np.float64]) -> tuple[float, int]:
    """Chi-square of what the images say about one pose and one shape for all, and its degrees of freedom.

    The shape belongs in it because it moves the joint pose: images that find the guide in the same place and the nail's
    holes of different width contradict one another. What an image does not tell of the shape does not count.

    Parameters
    ----------
    departures
        Of each image's pose from one that is close to all, shape (K, 6).
    """
    said = np.hstack([departures, np.stack([one.errors.shape_deviations for one in evidence])]).ravel()
    means = responses(evidence)
    size = means.shape[1]
    places = np.arange(len(means)) % size
    told = (places < POSE_SIZE) | (means[np.arange(len(means)), places] > _LEAST_RESPONSE)
    known = np.unique(places[told])
    precision = np.linalg.inv(block_diag(*(one.errors.own_covariance for one in evidence))[np.ix_(told, told)])
    means, said = means[np.ix_(told, known)], said[told]
    left = said - means @ np.linalg.solve(means.T @ precision @ means, means.T @ precision @ said)
    return float(left @ precision @ left), int(np.count_nonzero(told)) - len(known)


def image_correlation(first: PoseEvidence, second: PoseEvidence) -> float:
    """NoiseCorrelation of the errors that come with two images."""
    apart_deg = float(np.degrees(angle_between_rad(first.ray_nail, second.ray_nail)))
    return float(SHARED_FROM_ONE_DIRECTION * np.exp(-0.5 * (apart_deg / SHARED_WITHIN_DEG) ** 2))


def _response(errors: PoseErrors) -> NDArray[np.float64]:
    response = np.eye(len(errors.own_covariance))
    response[:, POSE_SIZE:] -= errors.shape_pull
    return response


def _counted_covariances(evidence: tuple[PoseEvidence, ...]) -> list[NDArray[np.float64]]:
    """Of each image, larger for those that share errors with others: as many from one place count little more than one.

    A poor image from its side makes a good one count less, too; the covariance of the result knows.
    """
    counted = []
    for k, one in enumerate(evidence):
        shared = sum(image_correlation(one, other) for m, other in enumerate(evidence) if m != k)
        covariance = (1.0 + shared) * one.errors.own_covariance
        covariance[POSE_SIZE:, POSE_SIZE:] += _LEAST_SHAPE_VARIANCE * np.eye(len(covariance) - POSE_SIZE)
        counted.append(covariance)
    return counted


def _root(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Symmetric root of the correlations, times the standard deviations: the same whatever the units are."""
    deviations = np.sqrt(np.diag(covariance))
    scale = np.where(deviations > 0.0, deviations, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return np.asarray(deviations[:, None] * ((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T))
