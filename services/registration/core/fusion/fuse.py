"""Several images of one set-up: the joint estimate of `guide_from_nail`, and how far the images are from it.

The guide must be in the same place on the bone in all of them; the C-arm may have moved. Depth is weak in one image and
seen from another direction, so what the images say is weighed with its full covariance (`joint_errors.py`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.fusion.joint_errors import covariance_of_mean, disagreement_of, weights_of
from services.registration.core.nail.parameters import POSE_SIZE
from services.registration.core.pose_evidence import PoseEvidence, motion_between, moved_by
from shared.geometry.frames import Guide, Nail
from shared.geometry.lines import read_only
from shared.geometry.transform import Transform

_ITERATIONS = 10
_CONVERGED = 1e-10


@dataclass(frozen=True, slots=True, eq=False)
class FusedPose:
    """The joint estimate.

    Attributes
    ----------
    guide_from_nail
        The pose.
    covariance
        Of a small motion of the nail in its own frame, as in `PoseEvidence`, shape (6, 6).
    weights
        How the error of each image's pose enters the joint one, shape (K, 6, 6).
    departures
        How far each image's pose is from the joint one, such motions, shape (K, 6).
    chi_square, degrees_of_freedom
        Sum of squares of what the images say, of poses and of the nail's shape, about their mean, over their
        covariance: as large, on average, as its degrees of freedom if nothing has moved.
    """

    guide_from_nail: Transform[Guide, Nail]
    covariance: NDArray[np.float64]
    weights: NDArray[np.float64]
    departures: NDArray[np.float64]
    chi_square: float
    degrees_of_freedom: int


def fuse(evidence: tuple[PoseEvidence, ...]) -> FusedPose:
    """Weighted mean of what one or more images say."""
    weights = weights_of(evidence)
    covariance = covariance_of_mean(evidence, weights)
    return fused_by(evidence, weights, covariance)


def fused_by(
    evidence: tuple[PoseEvidence, ...], weights: NDArray[np.float64], covariance: NDArray[np.float64]
) -> FusedPose:
    """The mean by weights, shape (K, 6, 6 + S), that has the covariance, shape (6, 6)."""
    of_poses, of_shapes = weights[:, :, :POSE_SIZE], weights[:, :, POSE_SIZE:]
    by_shape = np.einsum("kis,ks->i", of_shapes, np.stack([one.errors.shape_deviations for one in evidence]))
    pose = evidence[0].guide_from_nail
    for _ in range(_ITERATIONS):
        step = by_shape + np.einsum("kij,kj->i", of_poses, _departures(evidence, pose))
        pose = moved_by(pose, step)
        if float(np.abs(step).max()) < _CONVERGED:
            break
    departures = _departures(evidence, pose)
    disagreement = disagreement_of(evidence, departures)
    return FusedPose(pose, read_only(covariance), read_only(of_poses), read_only(departures), *disagreement)


def _departures(evidence: tuple[PoseEvidence, ...], pose: Transform[Guide, Nail]) -> NDArray[np.float64]:
    return np.stack([motion_between(pose, one.guide_from_nail) for one in evidence])
