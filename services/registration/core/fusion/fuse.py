"""Several images of one set-up: the joint estimate of `guide_from_nail`, and whether the images agree.

The guide must be in the same place on the bone in all of them; the C-arm may have moved. Depth is weak in one image and
seen from another direction, so poses are weighted with their full covariances. The weights take the images as
independent; the covariance of the result does not:

- what comes with an image (guide's balls, calibration, the nail's fit) is noise, which is new every time, and things
  that images from the same direction share, such as the bone's texture: the correlation falls with the angle between
  the directions;
- the model's own errors are mostly the same in all images, so that they hardly average out.

The correlations were measured on set-ups that were seen several times, and are taken on the safe side of what was found
(`docs/benchmarks/fusion.md`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.pose_evidence import PoseEvidence, motion_between, moved_by
from shared.geometry.frames import Guide, Nail
from shared.geometry.lines import angle_between_rad, read_only
from shared.geometry.transform import Transform

SHARED_FROM_ONE_DIRECTION = 0.7
SHARED_WITHIN_DEG = 3.0
SHARED_BY_THE_MODEL = 0.5
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
        How each image's error enters the joint one, shape (K, 6, 6).
    departures
        How far each image's pose is from the joint one, such motions, shape (K, 6).
    chi_square
        Their sum of squares, each over its own covariance: what would be 6 (K - 1) on average if nothing had moved.
    """

    guide_from_nail: Transform[Guide, Nail]
    covariance: NDArray[np.float64]
    weights: NDArray[np.float64]
    departures: NDArray[np.float64]
    chi_square: float

    @property
    def degrees_of_freedom(self) -> int:
        """Of `chi_square`."""
        return 6 * (len(self.departures) - 1)


def fuse(evidence: tuple[PoseEvidence, ...]) -> FusedPose:
    """Weighted mean of the poses of one or more images."""
    information = np.stack([np.linalg.inv(one.covariance) for one in evidence])
    weights = np.linalg.solve(information.sum(axis=0), information)
    pose = evidence[0].guide_from_nail
    for _ in range(_ITERATIONS):
        step = np.einsum("kij,kj->i", weights, _departures(evidence, pose))
        pose = moved_by(pose, step)
        if float(np.abs(step).max()) < _CONVERGED:
            break
    departures = _departures(evidence, pose)
    chi_square = float(np.einsum("ki,kij,kj->", departures, information, departures))
    covariance = np.einsum("kij,kljm,lnm->in", weights, joint_covariance(evidence), weights)
    return FusedPose(pose, read_only(covariance), read_only(weights), read_only(departures), chi_square)


def joint_covariance(evidence: tuple[PoseEvidence, ...]) -> NDArray[np.float64]:
    """Covariance of the errors of all images together, blocks of shape (K, K, 6, 6)."""
    roots = [_symmetric_root(one.image_covariance) for one in evidence]
    count = len(evidence)
    blocks = np.zeros((count, count, 6, 6))
    for k, first in enumerate(evidence):
        blocks[k, k] = first.covariance
        for m in range(k):
            second = evidence[m]
            shared = image_correlation(first, second) * roots[k] @ roots[m]
            blocks[k, m] = shared + SHARED_BY_THE_MODEL * first.model_loadings @ second.model_loadings.T
            blocks[m, k] = blocks[k, m].T
    return blocks


def image_correlation(first: PoseEvidence, second: PoseEvidence) -> float:
    """Correlation of the errors that come with two images."""
    apart_deg = float(np.degrees(angle_between_rad(first.ray_nail, second.ray_nail)))
    return float(SHARED_FROM_ONE_DIRECTION * np.exp(-0.5 * (apart_deg / SHARED_WITHIN_DEG) ** 2))


def _departures(evidence: tuple[PoseEvidence, ...], pose: Transform[Guide, Nail]) -> NDArray[np.float64]:
    return np.stack([motion_between(pose, one.guide_from_nail) for one in evidence])


def _symmetric_root(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)
