"""The paper's guide: balls by circles and correlation, the pattern's axes by principal components, pose from points.

"The major and minor axes of the targeting drill guide pattern are then determined from the fiducial locations using
Principal Component Analysis", and its pose "from the extrinsic camera parameters and the known geometry". How the balls
get their names the paper does not say, and principal axes of all discs, whatever they belong to, are of no use. So
the names are those of the project's own search, on the discs that the paper's means found: that serves the method best.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.image_points import Correspondences, pose_covariance, residuals_px
from services.registration.core.estimation.pose_estimate import PoseEstimate
from services.registration.core.guide.as_built import focal_length_of
from services.registration.core.guide.identity import GuideIdentity, needed_balls
from services.registration.core.guide.locate import GuideFit
from services.registration.core.guide.search import search_guide
from shared.errors import Accepted, Reason, ReasonCode, Rejected
from shared.geometry.calibration import NOT_OF_THE_RING, CArmCalibration
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Guide
from shared.geometry.lines import read_only
from shared.geometry.parts import GuidePart, RingPart
from shared.geometry.transform import Transform

_MOST_DISCS = 70
_LEAST_MARGIN = 3
_LEAST_FOR_A_POSE = 6
_REACHES_PX = (4.0, 2.5, 1.5)
_CENTRE_SD_PX = 0.3
_SOURCE_SHARE = 0.64

Names = tuple[NDArray[np.int64], NDArray[np.int64]]


def locate_guide_by_axes(
    calibration: CArmCalibration, ring: RingPart, guide: GuidePart
) -> Accepted[GuideFit] | Rejected:
    """Find the guide among the discs of a calibrated image that are not the ring's.

    Returns
    -------
    Accepted or Rejected
        Rejected with `guide_not_found`, `guide_ambiguous` or `guide_too_few_balls`.
    """
    discs = _discs(calibration, ring)[:_MOST_DISCS]
    ideal_px = calibration.distortion.undistort(calibration.balls.centre_px[discs])
    identities = search_guide(calibration.camera, guide.balls.position_mm, ideal_px, calibration.pixel_mm)
    counts = [len(identity) for identity in identities[:2]] + [0, 0]
    if counts[0] < _LEAST_FOR_A_POSE:
        return _rejected(
            ReasonCode.GUIDE_NOT_FOUND,
            f"of {len(ideal_px)} discs at most {counts[0]} fit the guide's pattern of {len(guide.balls)} balls (limit "
            f"{_LEAST_FOR_A_POSE}); check that the drill guide is in the image and that its file is the right one",
        )
    if counts[0] - counts[1] < _LEAST_MARGIN:
        return _rejected(
            ReasonCode.GUIDE_AMBIGUOUS,
            f"two positions of the guide explain {counts[0]} and {counts[1]} discs (limit of the difference "
            f"{_LEAST_MARGIN}); turn the C-arm a few degrees so that fewer balls are covered and take one more image",
        )
    fit = _fitted(calibration, guide, identities[0], ideal_px, discs, counts[0] - counts[1])
    needed = needed_balls(len(guide.balls))
    if fit.balls_found < needed:
        return _rejected(
            ReasonCode.GUIDE_TOO_FEW_BALLS,
            f"circles and correlation found {fit.balls_found} of the guide's {len(guide.balls)} balls (limit "
            f"{needed}); uncover the balls by turning the C-arm a few degrees, or use the model method",
        )
    return Accepted(fit)


def _rejected(code: ReasonCode, message: str) -> Rejected:
    return Rejected((Reason(code, message),))


def _discs(calibration: CArmCalibration, ring: RingPart) -> NDArray[np.int64]:
    """Indices of discs that are not balls of the ring, neither named nor where one must be."""
    where = calibration.image_from_camera(calibration.camera_from_ring @ ring.balls.position_mm)
    apart = np.linalg.norm(calibration.balls.centre_px[:, None] - where[None], axis=-1).min(axis=1, initial=np.inf)
    free = (calibration.balls.ring_index == NOT_OF_THE_RING) & (apart > 0.5 * calibration.balls.radius_px)
    return np.flatnonzero(free).astype(np.int64)


def pose_on_axes(
    camera: PinholeCamera, balls_mm: NDArray[np.float64], ideal_px: NDArray[np.float64], depth_mm: float
) -> Transform[Camera, Guide]:
    """Pose that faces the beam and lays the balls' principal axes on those of their shadows.

    Parameters
    ----------
    balls_mm, ideal_px
        The same balls in the guide's frame, shape (N, 3), and where they are seen, shape (N, 2).
    depth_mm
        Rough distance from the focal spot.
    """
    flat = balls_mm[:, :2] - balls_mm[:, :2].mean(axis=0)
    seen = ideal_px - ideal_px.mean(axis=0)
    seen_from_flat = np.linalg.lstsq(flat, seen, rcond=None)[0].T
    axes_flat, axes_seen = (np.linalg.eigh(points.T @ points)[1][:, ::-1] for points in (flat, seen))
    # a principal axis has no sign: the one that the names of the balls demand
    axes_seen = axes_seen * np.sign(np.sum((seen_from_flat @ axes_flat) * axes_seen, axis=0))
    # a guide seen from behind looks reflected: then the third axis points the other way
    rotation = np.eye(3)
    rotation[:2, :2] = axes_seen @ axes_flat.T
    rotation[2, 2] = np.linalg.det(rotation[:2, :2])
    middle = camera.rays(ideal_px.mean(axis=0)[None])[0]
    shift_mm = middle * (depth_mm / middle[2]) - rotation @ balls_mm.mean(axis=0)
    return Transform.from_rotation_translation(rotation, shift_mm)


def _fitted(
    calibration: CArmCalibration,
    guide: GuidePart,
    identity: GuideIdentity,
    ideal_px: NDArray[np.float64],
    discs: NDArray[np.int64],
    margin: int,
) -> GuideFit:
    """Principal axes, then least squares on the points, those off their place left out in turn."""
    camera, balls_mm = calibration.camera, guide.balls.position_mm
    ball, disc = identity.ball_index, identity.disc_index
    depth_mm = _SOURCE_SHARE * float(calibration.camera_from_ring.translation_mm[2])
    pose = pose_on_axes(camera, balls_mm[ball], ideal_px[disc], depth_mm)
    pose = _least_squares(camera, balls_mm[ball], ideal_px[disc], pose)
    for reach in _REACHES_PX:
        off = np.hypot(*(camera.project(pose.points(balls_mm[ball])) - ideal_px[disc]).T)
        keep = off < max(reach, 1.5 * float(np.median(off)))
        ball, disc = ball[keep], disc[keep]
        pose = _least_squares(camera, balls_mm[ball], ideal_px[disc], pose)
    return _guide_fit(calibration, guide, pose, (ball, discs[disc]), margin)


def _least_squares(
    camera: PinholeCamera, balls_mm: NDArray[np.float64], ideal_px: NDArray[np.float64], pose: Transform[Camera, Guide]
) -> Transform[Camera, Guide]:
    """OpenCV's pose from points, from a start."""
    turn, shift = cv2.solvePnPRefineLM(
        balls_mm,
        ideal_px,
        np.asarray(camera.intrinsic_matrix_px),
        np.zeros(4),
        pose.rotation_vector_rad[:, None],
        pose.translation_mm[:, None].copy(),
    )
    return Transform.from_rotvec(np.ravel(turn), np.ravel(shift))


def _guide_fit(
    calibration: CArmCalibration, guide: GuidePart, pose: Transform[Camera, Guide], names: Names, margin: int
) -> GuideFit:
    ball, disc = names
    count = len(guide.balls)
    used = np.zeros(count, dtype=bool)
    used[ball] = True
    ideal = np.zeros((count, 2))
    ideal[ball] = calibration.distortion.undistort(calibration.balls.centre_px[disc])
    deviation = np.where(used, _CENTRE_SD_PX, 1.0)
    seen = Correspondences(guide.balls.position_mm, ideal, deviation).chosen(used)
    off = residuals_px(calibration.camera, pose, seen)
    return GuideFit(
        pose=PoseEstimate.of(pose, pose_covariance(calibration.camera, pose, seen)),
        used=used,
        ideal_px=read_only(ideal),
        standard_deviation_px=read_only(deviation),
        balls_expected=count,
        reprojection_rms_px=float(np.sqrt(np.mean(np.sum(off**2, axis=1)))),
        runner_up_margin=margin,
        focal_length=focal_length_of(calibration.camera, pose, seen, np.zeros((len(seen), len(seen)))),
    )
