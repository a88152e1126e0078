"""The guide in a frame of running fluoroscopy, from its pose in the frame before: no search over directions.

Between two frames the guide's shadow hardly turns: one shift puts most of its balls near discs that imaging has
measured, and a few rounds of assignment and fit refine the pose.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from services.registration.core.acceptance.criteria import FRAME_GUIDE_BALLS, FRAME_GUIDE_RMS
from services.registration.core.estimation.image_points import (
    Correspondences,
    down_weighted,
    pose_covariance,
    refine_pose,
)
from services.registration.core.estimation.pose_estimate import PoseEstimate
from services.registration.core.guide.identity import Discs, refined_identity
from services.registration.core.guide.locate import needed_balls
from services.registration.core.tuning import GUIDE_MEASUREMENT, GUIDE_TRACKING
from shared.errors import Accepted, Rejected
from shared.geometry.calibration import NOT_OF_THE_RING, CArmCalibration
from shared.geometry.frames import Camera, Guide
from shared.geometry.parts import GuidePart
from shared.geometry.transform import Transform
from shared.xray.pixel_scale import pixels


@dataclass(frozen=True, slots=True, eq=False)
class TrackedGuide:
    """The guide in this frame.

    Attributes
    ----------
    pose
        As `GuideFit.pose`, but with the errors of the balls alone.
    balls_found, reprojection_rms_px
        Number of balls it is estimated from, and their rms distance from their predicted places.
    """

    pose: PoseEstimate[Camera, Guide]
    balls_found: int
    reprojection_rms_px: float


def track_guide(
    calibration: CArmCalibration, guide: GuidePart, before: Transform[Camera, Guide]
) -> Accepted[TrackedGuide] | Rejected:
    """Find the guide near where it was in an earlier frame.

    Parameters
    ----------
    calibration
        Of this frame; its discs that are not of the ring are the candidates.
    before
        Pose in the earlier frame.
    """
    chosen = _possible_discs(calibration, guide, before)
    ideal_px = calibration.distortion.undistort(calibration.balls.centre_px[chosen])
    needed = needed_balls(len(guide.balls))
    if len(ideal_px) < needed:
        return _lost(len(ideal_px), needed, len(guide.balls))
    balls_mm, camera = guide.balls.position_mm, calibration.camera
    shift_px = _common_shift_px(camera.project(before.points(balls_mm)), ideal_px, calibration.pixel_mm)
    start = _shifted(before, calibration, shift_px)
    discs = Discs.of(camera, ideal_px, calibration.pixel_mm)
    identity = refined_identity(camera, balls_mm, discs, start)
    if len(identity) < needed:
        return _lost(len(identity), needed, len(guide.balls))
    disc = chosen[identity.disc_index]
    deviation = np.hypot(calibration.balls.standard_deviation_px[disc], GUIDE_MEASUREMENT.systematic_sd_px)
    seen = Correspondences(balls_mm[identity.ball_index], ideal_px[identity.disc_index], deviation)
    return _accepted(calibration, guide, refine_pose(camera, identity.camera_from_guide, seen), seen)


def _accepted(
    calibration: CArmCalibration, guide: GuidePart, pose: Transform[Camera, Guide], seen: Correspondences
) -> Accepted[TrackedGuide] | Rejected:
    apart = seen.ideal_px - calibration.camera.project(pose.points(seen.body_mm))
    rms_px = float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))
    if not FRAME_GUIDE_RMS.is_met(rms_px):
        observation = (
            f"{len(seen)} of the guide's {len(guide.balls)} balls lie {FRAME_GUIDE_RMS.quoted(rms_px)} from where the "
            "guide's pose predicts them: it or the patient moves"
        )
        return Rejected((FRAME_GUIDE_RMS.reason(observation),))
    weighed = down_weighted(calibration.camera, pose, seen)
    covariance = pose_covariance(calibration.camera, pose, weighed)
    return Accepted(TrackedGuide(PoseEstimate.of(pose, covariance), len(seen), rms_px))


def _possible_discs(
    calibration: CArmCalibration, guide: GuidePart, pose: Transform[Camera, Guide]
) -> NDArray[np.int64]:
    """Indices of the discs that are not the ring's, of the size that the guide's balls have at this depth."""
    balls = calibration.balls
    radius_px = 0.5 * guide.balls.diameter_mm * calibration.camera.focal_length_px / pose.translation_mm[2]
    smallest = GUIDE_TRACKING.least_radius * radius_px.min()
    largest = GUIDE_TRACKING.greatest_radius * radius_px.max()
    possible = (balls.radius_px > smallest) & (balls.radius_px < largest) & (balls.ring_index == NOT_OF_THE_RING)
    return np.flatnonzero(possible).astype(np.int64)


def _common_shift_px(
    predicted_px: NDArray[np.float64], detected_px: NDArray[np.float64], pixel_mm: float
) -> NDArray[np.float64]:
    """The shift, shape (2,), that most pairs of a predicted and a detected place have in common."""
    shifts = (detected_px[None] - predicted_px[:, None]).reshape(-1, 2)
    shifts = shifts[np.linalg.norm(shifts, axis=1) < pixels(GUIDE_TRACKING.largest_shift_detector_mm, pixel_mm)]
    if len(shifts) == 0:
        return np.zeros(2)
    near = cKDTree(shifts).query_ball_point(shifts, pixels(GUIDE_TRACKING.same_shift_detector_mm, pixel_mm))
    best = max(near, key=len)
    return np.asarray(np.median(shifts[best], axis=0))


def _shifted(
    pose: Transform[Camera, Guide], calibration: CArmCalibration, shift_px: NDArray[np.float64]
) -> Transform[Camera, Guide]:
    """The pose moved across the beam, so that its image shifts."""
    by_mm = shift_px * float(pose.translation_mm[2]) / calibration.camera.focal_length_px
    shifted_mm = pose.translation_mm + np.array([by_mm[0], by_mm[1], 0.0])
    return Transform.from_rotation_translation(pose.rotation, shifted_mm)


def _lost(found: int, needed: int, expected: int) -> Rejected:
    observation = (
        f"of the guide's {expected} balls {FRAME_GUIDE_BALLS.quoted(found, needed)} were found near where the last "
        "frame showed them: the view has jumped, or the guide is covered"
    )
    return Rejected((FRAME_GUIDE_BALLS.reason(observation),))
