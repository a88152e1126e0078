"""The guide in a frame of running fluoroscopy, from its pose in the frame before: no search over directions.

Between two frames the guide's shadow hardly turns: one shift puts most of its balls near discs that imaging has
measured, and a few rounds of assignment and fit refine the pose.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from services.registration.core.acceptance.criteria import FRAME_GUIDE_BALLS, FRAME_GUIDE_RMS
from services.registration.core.estimation.image_points import (
    Correspondences,
    down_weighted,
    pose_covariance,
    refine_pose,
    reprojection_rms_px,
)
from services.registration.core.estimation.pose_estimate import PoseEstimate
from services.registration.core.guide.as_built import px_per_mm
from services.registration.core.guide.identity import Discs, refined_identity
from services.registration.core.guide.locate import needed_balls
from services.registration.core.tuning import GUIDE_MEASUREMENT, GUIDE_TRACKING
from shared.errors import Accepted, Rejected
from shared.geometry.calibration import NOT_OF_THE_RING, CArmCalibration
from shared.geometry.frames import Camera, Guide
from shared.geometry.parts import GuidePart
from shared.geometry.transform import Transform
from shared.xray.pixel_scale import pixels


def track_guide(
    calibration: CArmCalibration, guide: GuidePart, before: Transform[Camera, Guide]
) -> Accepted[PoseEstimate[Camera, Guide]] | Rejected:
    """Find the guide near where it was in an earlier frame; the errors are those of the balls alone."""
    chosen = _possible_discs(calibration, guide, before)
    ideal_px = calibration.distortion.undistort(calibration.balls.centre_px[chosen])
    needed = needed_balls(len(guide.balls))
    if len(ideal_px) < needed:
        return _lost(len(ideal_px), needed, len(guide.balls))
    balls_mm, camera = guide.balls.position_mm, calibration.camera
    shift_px = _common_shift_px(camera.project(before.points(balls_mm)), ideal_px, calibration.pixel_mm)
    # moved across the beam, so that its image shifts
    by_mm = np.append(shift_px, 0.0) * float(before.translation_mm[2]) / camera.focal_length_px
    start = Transform[Camera, Guide].from_rotation_translation(before.rotation, before.translation_mm + by_mm)
    identity = refined_identity(camera, balls_mm, Discs.of(camera, ideal_px, calibration.pixel_mm), start)
    if len(identity) < needed:
        return _lost(len(identity), needed, len(guide.balls))
    disc = chosen[identity.disc_index]
    place_px = px_per_mm(camera, start, balls_mm) * guide.balls.position_sd_mm
    own_px = np.hypot(calibration.balls.standard_deviation_px[disc], GUIDE_MEASUREMENT.systematic_sd_px)
    deviation = np.hypot(own_px, place_px[identity.ball_index])
    seen = Correspondences(balls_mm[identity.ball_index], ideal_px[identity.disc_index], deviation)
    return _accepted(calibration, guide, refine_pose(camera, identity.camera_from_guide, seen), seen)


def _accepted(
    calibration: CArmCalibration, guide: GuidePart, pose: Transform[Camera, Guide], seen: Correspondences
) -> Accepted[PoseEstimate[Camera, Guide]] | Rejected:
    rms_px = reprojection_rms_px(calibration.camera, pose, seen)
    if not FRAME_GUIDE_RMS.is_met(rms_px):
        observation = (
            f"{len(seen)} of the guide's {len(guide.balls)} balls lie {FRAME_GUIDE_RMS.quoted(rms_px)} from where the "
            "guide's pose predicts them: it or the patient moves"
        )
        return Rejected((FRAME_GUIDE_RMS.reason(observation),))
    weighed = down_weighted(calibration.camera, pose, seen)
    return Accepted(PoseEstimate.of(pose, pose_covariance(calibration.camera, pose, weighed)))


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


def _lost(found: int, needed: int, expected: int) -> Rejected:
    observation = (
        f"of the guide's {expected} balls {FRAME_GUIDE_BALLS.quoted(found, needed)} were found near where the last "
        "frame showed them: the view has jumped, or the guide is covered"
    )
    return Rejected((FRAME_GUIDE_BALLS.reason(observation),))
