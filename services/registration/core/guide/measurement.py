"""The guide's balls measured where a pose puts them, and the pose fitted to what was measured."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.guide.identity import GuideIdentity
from services.registration.core.pose import Correspondences, RigidPose, refine_pose, residuals_px
from shared.geometry.calibration import NOT_OF_THE_RING, CArmCalibration
from shared.geometry.parts import GuidePart, RingPart
from shared.xray.measurement import BallMeasurements, Discs, MeasurementSettings, measure_balls

OUTLIER_SIGMAS = 4.0
_SYSTEMATIC_PX = 0.06
_REJECTION_ROUNDS = 4
_MEDIAN_OF_RAYLEIGH = 1.1774
# A ring's ball nearer than this share of a guide ball's radius cannot be told from it.
_CONCENTRIC = 0.7
_WIDE_DRIFT_PX, _DRIFT_PX = 1.0, 0.4
# From so many discs a pose is good enough to look narrowly: looking widely first, it ended a twentieth of its
# uncertainty elsewhere in the median of 120 own scenes, and at most 0.6 of it.
_ENOUGH_NAMED = 12
# 1000 mm from focal spot to detector in pixels of 0.235 mm.
_USUAL_FOCAL_LENGTH_PX = 4255.0


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What measuring the balls takes.

    Attributes: `usable` mask of the image; `ring_shadows` where the ring's balls are; `shrunk` measured over geometric
    radius of the guide's balls, which the display's curve makes smaller.
    """

    pixels: NDArray[np.float32]
    usable: NDArray[np.bool_]
    calibration: CArmCalibration
    guide: GuidePart
    ring_shadows: Discs
    shrunk: float


def ball_radius_px(calibration: CArmCalibration, guide: GuidePart, pose: RigidPose) -> NDArray[np.float64]:
    """Geometric radii of the balls' shadows, shape (N,)."""
    depth_mm = pose.points(guide.balls.position_mm)[:, 2]
    return np.asarray(0.5 * calibration.camera.focal_length_px * guide.balls.diameter_mm / depth_mm)


def shrinkage(
    calibration: CArmCalibration, guide: GuidePart, identity: GuideIdentity, disc_radius_px: NDArray[np.float64]
) -> float:
    """Measured over geometric radius of the discs that were identified: the display's curve makes shadows smaller."""
    geometric = ball_radius_px(calibration, guide, identity.pose)[identity.ball_index]
    return float(np.clip(np.median(disc_radius_px[identity.disc_index] / geometric), 0.7, 1.1))


def ring_shadows(calibration: CArmCalibration, ring: RingPart) -> Discs:
    """All balls of the ring: measured where they were seen, else where they must be, smaller by the same share."""
    at_camera = calibration.camera_from_ring.points(ring.balls.position_mm)
    centre = calibration.image_from_camera(at_camera)
    radius = 0.5 * calibration.camera.focal_length_px * ring.balls.diameter_mm / at_camera[:, 2]
    index = calibration.balls.ring_index
    known = index != NOT_OF_THE_RING
    seen_radius = calibration.balls.radius_px[known]
    radius *= float(np.median(seen_radius / radius[index[known]])) if known.any() else 1.0
    centre[index[known]], radius[index[known]] = calibration.balls.centre_px[known], seen_radius
    return Discs(centre, radius)


def measured_and_fitted(look: Look, identity: GuideIdentity) -> tuple[RigidPose, Correspondences, NDArray[np.bool_]]:
    """Measure all balls where an identity puts them and fit the pose to them as if no error were shared.

    A pose that rests on few discs is first mended by a wider look.
    """
    pose = identity.pose
    if len(identity) < _ENOUGH_NAMED:
        pose, seen, used = _measured_and_fitted(look, pose, _settings(look.calibration, _WIDE_DRIFT_PX))
        if np.count_nonzero(used) < 4:
            return pose, seen, used
    return _measured_and_fitted(look, pose, _settings(look.calibration, _DRIFT_PX))


def _settings(calibration: CArmCalibration, drift_px: float) -> MeasurementSettings:
    """How to measure: blur is a matter of millimetres, so that finer pixels need wider surroundings."""
    usual = MeasurementSettings()
    finer = max(1.0, calibration.camera.focal_length_px / _USUAL_FOCAL_LENGTH_PX)
    return MeasurementSettings(
        reach_px=usual.reach_px * finer, blur_px=usual.blur_px * finer, drift_px=drift_px * finer
    )


def _measured_and_fitted(
    look: Look, pose: RigidPose, settings: MeasurementSettings
) -> tuple[RigidPose, Correspondences, NDArray[np.bool_]]:
    """Measure, then fit and leave out outliers until none is left."""
    camera = look.calibration.camera
    balls, alone = _measured(look, pose, settings)
    candidates = balls.seen & alone
    seen = _correspondences(look.calibration, look.guide, balls)
    doubt_px = np.hypot(seen.standard_deviation_px, _distortion_deviation(look.calibration, balls))
    unsure = Correspondences(seen.body_mm, seen.ideal_px, doubt_px)
    used = candidates
    for _ in range(_REJECTION_ROUNDS):
        if np.count_nonzero(used) < 4:
            break
        pose = refine_pose(camera, pose, unsure.chosen(used))
        distance = np.linalg.norm(residuals_px(camera, pose, seen), axis=1)
        scale = max(1.0, float(np.median(distance[used] / doubt_px[used])) / _MEDIAN_OF_RAYLEIGH)
        inliers = candidates & (distance < OUTLIER_SIGMAS * scale * doubt_px)
        if np.array_equal(inliers, used):
            break
        used = inliers
    return pose, seen, used


def _measured(look: Look, pose: RigidPose, settings: MeasurementSettings) -> tuple[BallMeasurements, NDArray[np.bool_]]:
    """Measurements of all balls, and whether no ball of the ring lies on them, shape (N,)."""
    predicted = look.calibration.image_from_camera(pose.points(look.guide.balls.position_mm))
    radius = look.shrunk * ball_radius_px(look.calibration, look.guide, pose)
    ring = look.ring_shadows
    balls = measure_balls(look.pixels, predicted, radius, ring.centre_px, ring.radius_px, settings, look.usable)
    apart = np.linalg.norm(predicted[:, None] - ring.centre_px[None], axis=-1)
    return balls, (apart > _CONCENTRIC * radius[:, None]).all(axis=1)


def _correspondences(calibration: CArmCalibration, guide: GuidePart, balls: BallMeasurements) -> Correspondences:
    """Where balls were seen, with the standard deviations of their own errors: not those of the distortion."""
    centre = np.where(balls.seen[:, None], balls.centre_px, 0.0)
    deviation = np.hypot(balls.standard_deviation_px, _SYSTEMATIC_PX)
    return Correspondences(
        guide.balls.position_mm, calibration.distortion.undistort(centre), np.where(balls.seen, deviation, 1.0)
    )


def _distortion_deviation(calibration: CArmCalibration, balls: BallMeasurements) -> NDArray[np.float64]:
    """Standard deviation of the distortion at the balls that were seen, shape (N,)."""
    return calibration.distortion.standard_deviation_at(np.where(balls.seen[:, None], balls.centre_px, 0.0))
