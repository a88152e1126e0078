"""Other ways to join poses with covariances, for comparison: each gives weights and the covariance it promises."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from services.registration.core.fusion.fuse import FusedPose, fuse, joint_covariance
from services.registration.core.pose_evidence import PoseEvidence, motion_between, moved_by

_ITERATIONS = 8
Floats = NDArray[np.float64]
Weighing = Callable[[tuple[PoseEvidence, ...]], tuple[Floats, Floats]]


def joined(evidence: tuple[PoseEvidence, ...], weighing: Weighing) -> FusedPose:
    """The weighted mean of some images' poses."""
    weights, covariance = weighing(evidence)
    pose = evidence[0].guide_from_nail
    for _ in range(_ITERATIONS):
        departures = np.stack([motion_between(pose, one.guide_from_nail) for one in evidence])
        pose = moved_by(pose, np.einsum("kij,kj->i", weights, departures))
    return FusedPose(pose, covariance, weights, departures, 0.0)


def as_shipped(evidence: tuple[PoseEvidence, ...]) -> tuple[Floats, Floats]:
    """Weights of independent images, covariance of what images share."""
    joint = fuse(evidence)
    return joint.weights, joint.covariance


def as_independent(evidence: tuple[PoseEvidence, ...]) -> tuple[Floats, Floats]:
    """The same weights, and the covariance that independent images would leave."""
    information = np.stack([np.linalg.inv(one.covariance) for one in evidence])
    covariance = np.asarray(np.linalg.inv(information.sum(axis=0)), dtype=np.float64)
    return np.asarray(covariance @ information), covariance


def by_correlated_weights(evidence: tuple[PoseEvidence, ...]) -> tuple[Floats, Floats]:
    """Generalised least squares: weights from the correlated covariance too."""
    count = len(evidence)
    together = joint_covariance(evidence).transpose(0, 2, 1, 3).reshape(6 * count, 6 * count)
    all_same = np.tile(np.eye(6), (count, 1))
    information = np.linalg.solve(together, all_same).T
    covariance = np.asarray(np.linalg.inv(information @ all_same), dtype=np.float64)
    weights = (covariance @ information).reshape(6, count, 6).transpose(1, 0, 2)
    return np.asarray(weights), covariance


def by_covariance_intersection(evidence: tuple[PoseEvidence, ...]) -> tuple[Floats, Floats]:
    """For two images whose correlation nobody knows: the mixture of informations with the largest determinant."""
    first, second = (np.linalg.inv(one.covariance) for one in evidence)
    found = minimize_scalar(
        lambda share: -np.linalg.slogdet(share * first + (1.0 - share) * second)[1], bounds=(0.0, 1.0), method="bounded"
    )
    parts = np.stack([found.x * first, (1.0 - found.x) * second])
    covariance = np.asarray(np.linalg.inv(parts.sum(axis=0)), dtype=np.float64)
    return np.asarray(covariance @ parts), covariance
