"""How far the guide's balls lie from where its file puts them, beyond their measurement: the guide as built.

Each ball's displacement is a random effect with one standard deviation for all of them. It is estimated only where the
residuals are larger than measurement explains: a covariance that is estimated from few balls is itself uncertain.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import expit, logit

from services.registration.core.estimation.image_points import (
    Body,
    Correspondences,
    projection_jacobian,
    residuals_px,
)
from services.registration.core.estimation.pose_estimate import POSE_SIZE
from services.registration.core.tuning import GUIDE_AS_BUILT
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera
from shared.geometry.transform import Transform

# End of the search for a root: far more than any ball is out of its place.
_LARGEST_MM = 10.0
_LEAST_INFORMATION = 1e-12  # of balls in one plane across the beam, which have no perspective


@dataclass(frozen=True, slots=True)
class FocalLength:
    """The focal length that a body's balls give, over the camera's, less one.

    Attributes: `standard_deviation` by the balls alone; `explained` share of the balls' chi-square that goes with it.
    """

    excess: float
    standard_deviation: float
    explained: float

    def sigmas(self, of_camera: float) -> float:
        """Conflict with the camera's own, whose relative standard deviation is given, in standard deviations."""
        return self.excess / float(np.hypot(self.standard_deviation, of_camera))

    def conflict(self, of_camera: float) -> float:
        """Relative standard deviation that the camera's focal length has beside its own.

        The ring's plates are as filed, or, with a prior probability, apart by another distance: the root of the second
        moment of the relative error under the posterior of this mixture, given what the balls of the guide show.
        """
        agreeing = self.standard_deviation**2 + of_camera**2
        # of the excess, by which the plates are expected to be wrong if they are
        share = GUIDE_AS_BUILT.other_ring_sd**2 / (GUIDE_AS_BUILT.other_ring_sd**2 + agreeing)
        evidence = 0.5 * (np.log1p(-share) + share * self.excess**2 / agreeing)
        other = float(expit(logit(GUIDE_AS_BUILT.other_ring) + evidence))
        spread = (share * self.excess) ** 2 + (1.0 - share) * GUIDE_AS_BUILT.other_ring_sd**2
        return float(np.sqrt(other * spread))


_NO_FOCAL_LENGTH: Final = FocalLength(0.0, np.inf, 0.0)


def px_per_mm(
    camera: PinholeCamera, camera_from_body: Transform[Camera, Body], body_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Pixels by which a millimetre across the beam shows at points, shape (N, 3); shape (N,)."""
    return np.asarray(camera.focal_length_px / camera_from_body.points(body_mm)[:, 2])


def displacement_sd_mm(
    camera: PinholeCamera,
    camera_from_body: Transform[Camera, Body],
    seen: Correspondences,
    shared_px2: NDArray[np.float64],
) -> float:
    """Standard deviation per axis of the balls' places about their file's; 0 where measurement explains the residuals.

    Solves for the spread with which chi-square is what its degrees of freedom predict (DerSimonian and Laird, Meta-
    analysis in clinical trials, 1986).

    Parameters
    ----------
    seen
        With the standard deviations of the balls' own errors, stated tolerances included.
    shared_px2
        Covariance per axis of errors that balls share, shape (N, N).
    """
    freedom = 2 * len(seen) - POSE_SIZE
    if freedom < GUIDE_AS_BUILT.least_freedom:
        return 0.0
    J = projection_jacobian(camera, camera_from_body, seen.body_mm)
    residual = residuals_px(camera, camera_from_body, seen)
    scale = px_per_mm(camera, camera_from_body, seen.body_mm)

    def excess(spread_mm: float) -> float:
        own = np.diag(seen.standard_deviation_px**2 + (spread_mm * scale) ** 2)
        return _chi_square(J, residual, shared_px2 + own) / freedom

    if excess(0.0) < GUIDE_AS_BUILT.largest_chi_square:
        return 0.0
    if excess(_LARGEST_MM) > 1.0:
        return _LARGEST_MM
    return float(brentq(lambda spread_mm: excess(spread_mm) - 1.0, 0.0, _LARGEST_MM, xtol=1e-4))


def beside_px2(
    predicted_px: NDArray[np.float64],
    used: NDArray[np.bool_],
    disc_px: NDArray[np.float64],
    disc_sd_px: NDArray[np.float64],
    reach_px: float,
) -> NDArray[np.float64]:
    """Squared distances from where balls are predicted that no fit used to the sharp discs beside them, shape (K,).

    They are displaced farther than was looked for. Left out, the nearer ones make the guide look better than it is.

    Parameters
    ----------
    predicted_px, used
        Of all balls, ideal pixels, shape (N, 2), and whether the fit used them, shape (N,).
    disc_px, disc_sd_px
        Centres of discs that may be balls of the guide, ideal pixels, shape (D, 2), and their errors, shape (D,).
    reach_px
        Farther discs are others.
    """
    if not len(disc_px):
        return np.empty(0)
    apart2 = np.sum((predicted_px[:, None] - disc_px[None]) ** 2, axis=2)
    own = np.argmin(apart2, axis=0)[None] == np.arange(len(predicted_px))[:, None]
    certain = apart2 > (GUIDE_AS_BUILT.certain_deviations * disc_sd_px) ** 2
    nearest = np.where(own & certain & (apart2 < reach_px**2), apart2, np.inf).min(axis=1)
    return np.asarray(nearest[~used & np.isfinite(nearest)])


def focal_length_of(
    camera: PinholeCamera,
    camera_from_body: Transform[Camera, Body],
    seen: Correspondences,
    shared_px2: NDArray[np.float64],
) -> FocalLength:
    """The focal length that balls at several depths give, beside the camera's.

    To the first order a body whose planes are farther apart by a share shows as a camera whose focal length is shorter
    by that share. The scale of the whole body shows nowhere: a larger one farther away gives the same image.

    Parameters
    ----------
    seen, shared_px2
        As in `displacement_sd_mm`.
    """
    root = np.linalg.cholesky(shared_px2 + np.diag(seen.standard_deviation_px**2))
    J = projection_jacobian(camera, camera_from_body, seen.body_mm)
    by_focal_length = camera.project(camera_from_body.points(seen.body_mm)) - camera.intrinsic_matrix_px[:2, 2]
    pose, longer = _whitened(root, J), _whitened(root, by_focal_length[..., None])
    target = _whitened(root, residuals_px(camera, camera_from_body, seen)[..., None])[:, 0]
    unexplained = np.column_stack([longer, target])
    unexplained -= pose @ np.linalg.lstsq(pose, unexplained, rcond=None)[0]
    longer, target = unexplained.T
    information, before = float(longer @ longer), float(target @ target)
    if information <= _LEAST_INFORMATION:
        return _NO_FOCAL_LENGTH
    excess = float(longer @ target) / information
    return FocalLength(excess, 1.0 / np.sqrt(information), excess**2 * information / max(before, 1e-12))


def _chi_square(
    jacobian: NDArray[np.float64], residual_px: NDArray[np.float64], covariance_px2: NDArray[np.float64]
) -> float:
    """Of what no pose explains, both axes having the same covariance, shape (N, N)."""
    root = np.linalg.cholesky(covariance_px2)
    rows, target = _whitened(root, jacobian), _whitened(root, residual_px[..., None])[:, 0]
    left = target - rows @ np.linalg.lstsq(rows, target, rcond=None)[0]
    return float(left @ left)


def _whitened(root_px: NDArray[np.floating], per_point: NDArray[np.floating]) -> NDArray[np.float64]:
    """Rows of points, shape (N, 2, K), in units of errors whose covariance per axis has this root; shape (2 N, K)."""
    columns = per_point.shape[-1]
    return np.asarray(np.linalg.solve(root_px, per_point.reshape(len(per_point), -1)).reshape(-1, columns))
