"""Other ways to join poses with covariances, for comparison: each gives the pose and the covariance it promises."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from services.registration.core.estimation.joint import JointEstimate, covariance_of_mean, fuse, fused_by
from services.registration.core.fusion import Estimates
from shared.geometry.frames import Guide, Nail

Floats = NDArray[np.float64]
Joining = Callable[[Estimates], JointEstimate[Guide, Nail]]


def as_shipped(estimates: Estimates) -> JointEstimate[Guide, Nail]:
    """Of one nail, whose shape all images tell; covariance of what images share."""
    return fuse(estimates)


def as_poses_alone(estimates: Estimates) -> JointEstimate[Guide, Nail]:
    """Nothing but the poses, each with its own covariance; covariance of what images share."""
    weights = _and_no_shape(_independent(estimates)[0], estimates)
    return fused_by(estimates, weights, covariance_of_mean(tuple(one.errors for one in estimates), weights))


def as_independent(estimates: Estimates) -> JointEstimate[Guide, Nail]:
    """The same poses, with the covariance of images that share nothing."""
    weights, covariance = _independent(estimates)
    return fused_by(estimates, _and_no_shape(weights, estimates), covariance)


def by_covariance_intersection(estimates: Estimates) -> JointEstimate[Guide, Nail]:
    """For two images whose correlation nobody knows: the mixture of informations with the largest determinant."""
    first, second = (np.linalg.inv(one.covariance) for one in estimates)
    found = minimize_scalar(
        lambda share: -np.linalg.slogdet(share * first + (1.0 - share) * second)[1], bounds=(0.0, 1.0), method="bounded"
    )
    parts = np.stack([found.x * first, (1.0 - found.x) * second])
    covariance = np.asarray(np.linalg.inv(parts.sum(axis=0)), dtype=np.float64)
    return fused_by(estimates, _and_no_shape(np.asarray(covariance @ parts), estimates), covariance)


def _independent(estimates: Estimates) -> tuple[Floats, Floats]:
    """Weights, shape (K, 6, 6), and covariance of images that share nothing."""
    information = np.stack([np.linalg.inv(one.covariance) for one in estimates])
    covariance = np.asarray(np.linalg.inv(information.sum(axis=0)), dtype=np.float64)
    return np.asarray(covariance @ information), covariance


def _and_no_shape(weights: Floats, estimates: Estimates) -> Floats:
    """Weights of poses, shape (K, 6, 6), as those of poses and shapes, of which none counts."""
    none = np.zeros((len(weights), 6, len(estimates[0].errors.shape_deviations)))
    return np.concatenate([weights, none], axis=2)
