"""The nail in the guide's frame from one image, with what guide, nail and C-arm calibration leave uncertain."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.image_points import Correspondences, refine_pose
from services.registration.core.estimation.pose_estimate import (
    PoseErrors,
    PoseEstimate,
    length_that_gives_depth_mm,
    ray_to,
)
from services.registration.core.guide.locate import GuideFit, distortion_correlation_px
from services.registration.core.hole_axes import rims_of
from services.registration.core.nail.evidence import covariance_of_turns
from services.registration.core.nail.image_fit import NailFit
from services.registration.core.tuning import HOLE_RIMS, LAG
from shared.geometry.calibration import CArmCalibration
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.parts import GuidePart, NailPart
from shared.geometry.transform import Transform


@dataclass(frozen=True, slots=True, eq=False)
class NailEstimate:
    """The nail in the camera's frame, whichever method found it."""

    camera_from_nail: Transform[Camera, Nail]
    errors: PoseErrors | None  # of the pose; None for a method that does not know its errors
    # How much worse the best mirrored pose explains the pixels; None for methods without one
    mirror_margin: float | None
    error_ratio: float = 1.0  # by which the errors of its rotation exceed what the image's noise explains
    curvature_per_m: tuple[float, float] = (0.0, 0.0)  # of a nail that is bent, towards its y and z
    hole_spread_mm: float = 0.0  # standard deviation of the holes' places about their file's, as the image shows it
    display_turn_deg: float = 0.0  # standard error of its rotation by a display's curve that changes with the place
    second_bore_deg: float = 0.0  # see `FitEvidence.second_bore_deg`
    channel_deg: float = 0.0  # see `FitEvidence.channel_deg`
    beside_objects: bool = False  # see `FitEvidence.beside_objects`
    other_bend_deg: float = 0.0  # how far the holes' axes are of a nail bent otherwise that explains the image as well

    @property
    def covariance(self) -> NDArray[np.float64] | None:
        """Of a small motion of the nail in its own frame, shape (6, 6)."""
        return None if self.errors is None else self.errors.covariance

    def nail_as_found(self, nail: NailPart) -> NailPart:
        """The nail bent as it was found, its holes as far from their places as they are."""
        bent = nail.bent(self.curvature_per_m)
        as_filed = self.hole_spread_mm <= (nail.tolerance_mm or 0.0)
        return bent if as_filed else replace(bent, tolerance_mm=self.hole_spread_mm)

    @staticmethod
    def of_fit(fit: NailFit) -> "NailEstimate":
        """What a fit to the pixels determines of the pose."""
        return NailEstimate(
            fit.camera_from_nail,
            fit.errors,
            fit.evidence.mirror_margin,
            error_ratio=fit.evidence.error_ratio,
            curvature_per_m=fit.curvature_per_m,
            hole_spread_mm=fit.evidence.hole_spread_mm,
            display_turn_deg=fit.display_turn_deg,
            second_bore_deg=fit.evidence.second_bore_deg,
            channel_deg=fit.evidence.channel_deg,
            beside_objects=fit.evidence.beside_objects,
            other_bend_deg=fit.other_bend_deg,
        )


def guide_from_nail_of(
    calibration: CArmCalibration, guide: GuidePart, nail: NailPart, guide_fit: GuideFit, estimate: NailEstimate
) -> PoseEstimate[Guide, Nail] | None:
    """Estimate of `guide_from_nail` from one image; None for a method that does not know its errors."""
    if estimate.errors is None:
        return None
    nail = estimate.nail_as_found(nail)
    camera_from_nail = PoseEstimate(estimate.camera_from_nail, estimate.errors)
    chained = guide_fit.pose.inverse() @ camera_from_nail
    by_calibration = np.zeros((6, 6))
    for other in _poses_for_other_sources(calibration, guide, nail, guide_fit, camera_from_nail.mean):
        motion = chained.mean.motion_to(other)
        by_calibration += np.outer(motion, motion)
    ray, depth_sd_mm = ray_to(camera_from_nail.mean), _depth_errors_mm(calibration, nail, camera_from_nail.mean)
    by_calibration[3:, 3:] += depth_sd_mm @ depth_sd_mm * np.outer(ray, ray)
    by_lag = _covariance_by_lag(calibration, nail, guide_fit.lag_px, camera_from_nail.mean)
    return PoseEstimate(chained.mean, chained.errors.with_more(by_calibration + by_lag))


def _covariance_by_lag(
    calibration: CArmCalibration, nail: NailPart, lag_px: float, camera_from_nail: Transform[Camera, Nail]
) -> NDArray[np.float64]:
    """Covariance of the nail's pose in the guide's frame by earlier frames in the image, shape (6, 6).

    They displace the nail across the ray and turn it: tails lie on one side of its edges.
    """
    depth_mm = float(camera_from_nail.translation_mm[2])
    shift_mm = LAG.entry_per_tail * lag_px * depth_mm / calibration.camera.focal_length_px
    turn_rad = np.radians(LAG.turn_deg_per_px * lag_px)
    covariance = covariance_of_turns(nail, turn_rad**2 * np.eye(2))
    ray = ray_to(camera_from_nail)
    covariance[3:, 3:] += shift_mm**2 * (np.eye(3) - np.outer(ray, ray))
    return covariance


def _depth_errors_mm(
    calibration: CArmCalibration, nail: NailPart, camera_from_nail: Transform[Camera, Nail]
) -> NDArray[np.float64]:
    """Depth, one standard deviation, by the distortion's and the holes' errors of the length from hole to hole; (2,).

    Shifts that are common to the holes cancel: the guide's balls, which appear in the same place, have them too.
    """
    along = sorted((hole.axis.point_mm for hole in nail.holes), key=lambda point: float(point[0]))
    px = calibration.image_from_camera(camera_from_nail.points(np.array([along[0], along[-1]])))
    deviation_px = float(np.sqrt(np.sum(calibration.distortion.standard_deviation_at(px) ** 2)))
    apart = float(np.linalg.norm(px[1] - px[0])) / distortion_correlation_px(calibration)
    deviation_px *= np.sqrt(1.0 - np.exp(-0.5 * apart**2))
    depth_mm = float(camera_from_nail.translation_mm[2])
    by_distortion_mm = deviation_px * depth_mm / calibration.camera.focal_length_px
    by_tolerance_mm = np.sqrt(2.0) * (nail.tolerance_mm or 0.0)
    return np.array([by_distortion_mm, by_tolerance_mm]) * depth_mm / length_that_gives_depth_mm(nail)


def _poses_for_other_sources(
    calibration: CArmCalibration,
    guide: GuidePart,
    nail: NailPart,
    guide_fit: GuideFit,
    camera_from_nail: Transform[Camera, Nail],
) -> tuple[Transform[Guide, Nail], ...]:
    """What `guide_from_nail` would be if the focal spot lay one standard deviation elsewhere.

    The image stays as it is: guide and nail are fitted again, to the same pixels, by the camera with the other source.
    Of the nail the rims of its holes are taken, because they carry its pose.
    """
    rims = _rim_points(nail)
    rims_px = calibration.camera.project(camera_from_nail.points(rims))
    rims_seen = Correspondences(rims, rims_px, np.full(len(rims), HOLE_RIMS.sd_px))
    camera_from_guide, used = guide_fit.camera_from_guide, guide_fit.used
    balls = guide.balls.position_mm[used]
    balls_px = calibration.camera.project(camera_from_guide.points(balls))
    balls_seen = Correspondences(balls, balls_px, guide_fit.standard_deviation_px[used])
    return tuple(
        refine_pose(camera, camera_from_guide, balls_seen).inverse() @ refine_pose(camera, camera_from_nail, rims_seen)
        for camera in _cameras_with_other_sources(calibration, guide_fit)
    )


def _cameras_with_other_sources(calibration: CArmCalibration, guide_fit: GuideFit) -> tuple[PinholeCamera, ...]:
    """Cameras whose focal spot is moved by one standard deviation along the axes of its covariance.

    The image plane stays where it is, at the ring: a shift across the beam moves the principal point, one along the
    beam changes the focal length. A focal length that the guide's balls contradict is as uncertain as they differ.
    """
    to_camera = calibration.camera_from_ring.rotation
    distance_mm = float(calibration.camera_from_ring.translation_mm[2])
    covariance_mm2 = to_camera @ calibration.source_covariance_mm2 @ to_camera.T
    covariance_mm2[2, 2] += (distance_mm * guide_fit.focal_length.conflict(calibration.focal_length_deviation)) ** 2
    values, vectors = np.linalg.eigh(covariance_mm2)
    px_per_mm = calibration.camera.focal_length_px / distance_mm
    cameras = []
    for value, direction in zip(values, vectors.T, strict=True):
        x, y, z = np.sqrt(max(float(value), 0.0)) * direction * px_per_mm
        K = calibration.camera.intrinsic_matrix_px + np.array([[-z, 0.0, x], [0.0, -z, y], [0.0, 0.0, 0.0]])
        cameras.append(PinholeCamera(K))
    return tuple(cameras)


def _rim_points(nail: NailPart) -> NDArray[np.float64]:
    """Points on the circles where the holes meet the nail's surface, in the nail's frame, shape (K, 3), in mm."""
    angle = 2.0 * np.pi * np.arange(HOLE_RIMS.points) / HOLE_RIMS.points
    return np.concatenate([rims_of(nail, hole, angle).reshape(-1, 3) for hole in nail.holes])
