"""The guide's balls measured where a pose puts them, and the pose fitted to what was measured."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.image_points import Body, Correspondences, refine_pose, residuals_px
from services.registration.core.estimation.robust import inliers
from services.registration.core.guide.as_built import px_per_mm
from services.registration.core.guide.identity import GuideIdentity
from services.registration.core.tuning import GUIDE_MEASUREMENT
from shared.geometry.calibration import NOT_OF_THE_RING, CArmCalibration
from shared.geometry.frames import Camera, Guide
from shared.geometry.parts import BallPattern, GuidePart, RingPart
from shared.geometry.transform import Transform
from shared.xray.measurement import BallMeasurements, Discs, MeasurementSettings, measure_balls

# The pose, all balls as measured, and which of them it was fitted to, shape (N,).
Measured = tuple[Transform[Camera, Guide], Correspondences, NDArray[np.bool_]]


@dataclass(frozen=True, slots=True, eq=False)
class GuideImage:
    """What measuring the balls needs.

    Attributes: `usable` mask of the image; `ring_shadows` where the ring's balls are; `shrunk` measured over geometric
    radius of the guide's balls, which the display's curve makes smaller.
    """

    pixels: NDArray[np.float32]
    usable: NDArray[np.bool_]
    calibration: CArmCalibration
    guide: GuidePart
    ring_shadows: Discs
    shrunk: float


def shadows(calibration: CArmCalibration, balls: BallPattern, camera_from_balls: Transform[Camera, Body]) -> Discs:
    """Where balls appear, and the geometric radii of their shadows."""
    at_camera = camera_from_balls.points(balls.position_mm)
    radius_px = 0.5 * calibration.camera.focal_length_px * balls.diameter_mm / at_camera[:, 2]
    return Discs(calibration.image_from_camera(at_camera), radius_px)


def shrinkage(
    calibration: CArmCalibration, guide: GuidePart, identity: GuideIdentity, disc_radius_px: NDArray[np.float64]
) -> float:
    """Measured over geometric radius of the discs that were identified: the display's curve makes shadows smaller."""
    geometric = shadows(calibration, guide.balls, identity.camera_from_guide).radius_px[identity.ball_index]
    share = float(np.median(disc_radius_px[identity.disc_index] / geometric))
    return float(np.clip(share, GUIDE_MEASUREMENT.least_shrinkage, GUIDE_MEASUREMENT.most_shrinkage))


def ring_shadows(calibration: CArmCalibration, ring: RingPart) -> Discs:
    """All balls of the ring: measured where they were seen, else where they must be, smaller by the same share."""
    predicted, index = shadows(calibration, ring.balls, calibration.camera_from_ring), calibration.balls.ring_index
    known = index != NOT_OF_THE_RING
    seen_radius = calibration.balls.radius_px[known]
    shrunk = float(np.median(seen_radius / predicted.radius_px[index[known]])) if known.any() else 1.0
    centre, radius = predicted.centre_px.copy(), shrunk * predicted.radius_px
    centre[index[known]], radius[index[known]] = calibration.balls.centre_px[known], seen_radius
    return Discs(centre, radius)


def measured_and_fitted(image: GuideImage, identity: GuideIdentity) -> Measured:
    """Measure all balls where an identity puts them and fit the pose to them as if no error were shared.

    A pose from few discs is first refined in wider surroundings of the balls.
    """
    pose = identity.camera_from_guide
    if len(identity) < GUIDE_MEASUREMENT.enough_identified:
        wide = _measured_and_fitted(image, pose, _settings(image.calibration, GUIDE_MEASUREMENT.wide_drift_px))
        pose, _, used = wide
        if np.count_nonzero(used) < GUIDE_MEASUREMENT.fewest_balls:
            return wide
    return _measured_and_fitted(image, pose, _settings(image.calibration, GUIDE_MEASUREMENT.drift_px))


def measured_displaced(image: GuideImage, pose: Transform[Camera, Guide], displacement_sd_px: float) -> Measured:
    """The same from a pose whose prediction of each ball errs by the ball's displacement as well.

    Within the surroundings for balls that lie as filed a displaced one is measured nearer to its filed place, or not
    seen, and the others make the displacement look small.
    """
    usual = _settings(image.calibration, GUIDE_MEASUREMENT.drift_px)
    wide = replace(usual, drift_px=predicted_within_px(image, displacement_sd_px))
    return _measured_and_fitted(image, pose, wide, displacement_sd_px)


def predicted_within_px(image: GuideImage, displacement_sd_px: float) -> float:
    """Standard deviation with which a pose predicts balls that are displaced so much."""
    return float(np.hypot(_settings(image.calibration, GUIDE_MEASUREMENT.drift_px).drift_px, displacement_sd_px))


def _settings(calibration: CArmCalibration, drift_px: float) -> MeasurementSettings:
    """How to measure: blur is a matter of millimetres, so that finer pixels need wider surroundings."""
    usual = MeasurementSettings()
    finer = max(1.0, calibration.camera.focal_length_px / GUIDE_MEASUREMENT.usual_focal_length_px)
    return MeasurementSettings(
        reach_px=usual.reach_px * finer, blur_px=usual.blur_px * finer, drift_px=drift_px * finer
    )


def _measured_and_fitted(
    image: GuideImage, pose: Transform[Camera, Guide], settings: MeasurementSettings, displacement_sd_px: float = 0.0
) -> Measured:
    """Measure, then fit and leave out outliers until none is left: balls farther off than measured and displaced."""
    camera = image.calibration.camera
    balls, alone = _measured(image, pose, settings)
    candidates = balls.seen & alone
    seen = _correspondences(image.calibration, image.guide, balls, pose)
    seen_px = np.where(balls.seen[:, None], balls.centre_px, 0.0)
    of_distortion_px = image.calibration.distortion.standard_deviation_at(seen_px)
    total_sd_px = np.hypot(np.hypot(seen.standard_deviation_px, of_distortion_px), displacement_sd_px)
    of_both = Correspondences(seen.body_mm, seen.ideal_px, total_sd_px)
    used = candidates
    for _ in range(GUIDE_MEASUREMENT.most_rounds):
        if np.count_nonzero(used) < GUIDE_MEASUREMENT.fewest_balls:
            break
        pose = refine_pose(camera, pose, of_both.chosen(used))
        distance = np.linalg.norm(residuals_px(camera, pose, seen), axis=1)
        kept = candidates & inliers(
            distance / total_sd_px, used, GUIDE_MEASUREMENT.outlier_sigmas, least_spread=1.0, axes=2
        )
        if np.array_equal(kept, used):
            break
        used = kept
    return pose, seen, used


def _measured(
    image: GuideImage, pose: Transform[Camera, Guide], settings: MeasurementSettings
) -> tuple[BallMeasurements, NDArray[np.bool_]]:
    """Measurements of all balls, and whether no ball of the ring lies on them, shape (N,)."""
    predicted, ring = shadows(image.calibration, image.guide.balls, pose), image.ring_shadows
    centre, radius = predicted.centre_px, image.shrunk * predicted.radius_px
    balls = measure_balls(image.pixels, centre, radius, ring.centre_px, ring.radius_px, settings, image.usable)
    apart = np.linalg.norm(centre[:, None] - ring.centre_px[None], axis=-1)
    return balls, (apart > GUIDE_MEASUREMENT.concentric_share * radius[:, None]).all(axis=1)


def _correspondences(
    calibration: CArmCalibration, guide: GuidePart, balls: BallMeasurements, pose: Transform[Camera, Guide]
) -> Correspondences:
    """Where balls were seen, with the standard deviations of their own errors: not those of the distortion.

    Their own are those of measurement and, where the file states one, the tolerance of their places.
    """
    centre = np.where(balls.seen[:, None], balls.centre_px, 0.0)
    place_px = px_per_mm(calibration.camera, pose, guide.balls.position_mm) * guide.balls.position_sd_mm
    deviation = np.hypot(np.hypot(balls.standard_deviation_px, GUIDE_MEASUREMENT.systematic_sd_px), place_px)
    return Correspondences(
        guide.balls.position_mm, calibration.distortion.undistort(centre), np.where(balls.seen, deviation, 1.0)
    )
