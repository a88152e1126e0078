"""Other ways to join poses with covariances, for comparison: each gives the pose and the covariance it promises."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from services.registration.core.fusion.fuse import FusedPose, fuse, fused_by
from services.registration.core.fusion.joint_errors import covariance_of_mean
from services.registration.core.pose_evidence import PoseEvidence

Floats = NDArray[np.float64]
Joining = Callable[[tuple[PoseEvidence, ...]], FusedPose]


def as_shipped(evidence: tuple[PoseEvidence, ...]) -> FusedPose:
    """Of one nail, whose shape all images tell; covariance of what images share."""
    return fuse(evidence)


def as_poses_alone(evidence: tuple[PoseEvidence, ...]) -> FusedPose:
    """Nothing but the poses, each with its own covariance; covariance of what images share."""
    weights = _and_no_shape(_independent(evidence)[0], evidence)
    return fused_by(evidence, weights, covariance_of_mean(evidence, weights))


def as_independent(evidence: tuple[PoseEvidence, ...]) -> FusedPose:
    """The same poses, with the covariance of images that share nothing."""
    weights, covariance = _independent(evidence)
    return fused_by(evidence, _and_no_shape(weights, evidence), covariance)


def by_covariance_intersection(evidence: tuple[PoseEvidence, ...]) -> FusedPose:
    """For two images whose correlation nobody knows: the mixture of informations with the largest determinant."""
    first, second = (np.linalg.inv(one.covariance) for one in evidence)
    found = minimize_scalar(
        lambda share: -np.linalg.slogdet(share * first + (1.0 - share) * second)[1], bounds=(0.0, 1.0), method="bounded"
    )
    parts = np.stack([found.x * first, (1.0 - found.x) * second])
    covariance = np.asarray(np.linalg.inv(parts.sum(axis=0)), dtype=np.float64)
    return fused_by(evidence, _and_no_shape(np.asarray(covariance @ parts), evidence), covariance)


def _independent(evidence: tuple[PoseEvidence, ...]) -> tuple[Floats, Floats]:
    """Weights, shape (K, 6, 6), and covariance of images that share nothing."""
    information = np.stack([np.linalg.inv(one.covariance) for one in evidence])
    covariance = np.asarray(np.linalg.inv(information.sum(axis=0)), dtype=np.float64)
    return np.asarray(covariance @ information), covariance


def _and_no_shape(weights: Floats, evidence: tuple[PoseEvidence, ...]) -> Floats:
    """Weights of poses, shape (K, 6, 6), as those of poses and shapes, of which none counts."""
    none = np.zeros((len(weights), 6, len(evidence[0].errors.shape_deviations)))
    return np.concatenate([weights, none], axis=2)
