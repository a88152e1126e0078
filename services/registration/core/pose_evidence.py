"""What one image says of `guide_from_nail`: the pose, and its errors sorted by what shares them.

An error is a small motion of the nail in its own frame, rotation (rad) before translation (mm), shape (6,): the truth
is ``guide_from_nail @ motion``.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.drill_clearance import across_basis
from services.registration.core.guide.locate import DISTORTION_CORRELATION_PX, GuideFit
from services.registration.core.pose import Correspondences, RigidPose, refine_pose
from services.registration.core.pose_errors import PoseErrors, length_that_tells_depth_mm
from shared.geometry.calibration import CArmCalibration
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.lines import read_only, unit
from shared.geometry.parts import GuidePart, Hole, NailPart, hole_surface_points
from shared.geometry.transform import Transform

_RIM_POINTS = 8


@dataclass(frozen=True, slots=True, eq=False)
class PoseEvidence:
    """What one image says of `guide_from_nail`.

    Attributes
    ----------
    guide_from_nail
        The pose.
    ray_nail
        Unit direction of the ray to the nail, in the nail's frame, shape (3,): from where it was seen.
    errors
        Of the pose, those by guide and calibration among what comes with the image.
    """

    guide_from_nail: Transform[Guide, Nail]
    ray_nail: NDArray[np.float64]
    errors: PoseErrors

    def __post_init__(self) -> None:
        object.__setattr__(self, "ray_nail", read_only(self.ray_nail))

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Of the pose from this image alone, shape (6, 6)."""
        return self.errors.covariance


def pose_evidence(
    calibration: CArmCalibration,
    guide: GuidePart,
    nail: NailPart,
    guide_fit: GuideFit,
    camera_from_nail: Transform[Camera, Nail],
    nail_errors: PoseErrors,
) -> PoseEvidence:
    """Put together what guide, nail and C-arm calibration of one image leave uncertain.

    Parameters
    ----------
    nail_errors
        Of `camera_from_nail`.
    """
    guide_from_nail = guide_fit.camera_from_guide.inverse() @ camera_from_nail
    by_guide = motion_of_nail(guide_from_nail)
    covariance = by_guide @ guide_fit.covariance @ by_guide.T
    for other in _poses_for_other_sources(calibration, guide, nail, guide_fit, camera_from_nail):
        motion = motion_between(guide_from_nail, other)
        covariance = covariance + np.outer(motion, motion)
    depth = _depth_by_distortion(calibration, nail, camera_from_nail)
    covariance = covariance + np.outer(depth, depth)
    ray_nail = camera_from_nail.rotation.T @ unit(camera_from_nail.translation_mm)
    return PoseEvidence(guide_from_nail, ray_nail, nail_errors.with_more(covariance))


def _depth_by_distortion(
    calibration: CArmCalibration, nail: NailPart, camera_from_nail: Transform[Camera, Nail]
) -> NDArray[np.float64]:
    """Motion of the nail, one standard deviation, by what the distortion's errors make of that length; shape (6,).

    Of shifts that are common to the holes the guide's balls, which are seen in the same place, have their part.
    """
    along = sorted((hole.axis.point_mm for hole in nail.holes), key=lambda point: float(point[0]))
    px = calibration.image_from_camera(camera_from_nail.points(np.array([along[0], along[-1]])))
    deviation = float(np.sqrt(np.sum(calibration.distortion.standard_deviation_at(px) ** 2)))
    apart = float(np.linalg.norm(px[1] - px[0])) / DISTORTION_CORRELATION_PX
    deviation *= np.sqrt(1.0 - np.exp(-0.5 * apart**2))
    depth_mm = float(camera_from_nail.translation_mm[2])
    of_length_mm = deviation * depth_mm / calibration.camera.focal_length_px
    ray = camera_from_nail.rotation.T @ unit(camera_from_nail.translation_mm)
    return np.concatenate([np.zeros(3), of_length_mm * depth_mm / length_that_tells_depth_mm(nail) * ray])


def motion_of_nail(guide_from_nail: Transform[Guide, Nail]) -> NDArray[np.float64]:
    """Small motions of the guide in its own frame as motions of the nail in its own, shape (6, 6).

    A motion (w, t) of the guide moves its point y by w x y + t; with y = R x + p that is the nail's motion
    (R'w, R'(w x p + t)).
    """
    turned = guide_from_nail.rotation.T
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = matrix[3:, 3:] = turned
    matrix[3:, :3] = -turned @ cross_matrix(guide_from_nail.translation_mm)
    return matrix


def motion_between(reference: Transform[Guide, Nail], other: Transform[Guide, Nail]) -> NDArray[np.float64]:
    """Small motion of the nail in its own frame that takes one pose to another, shape (6,)."""
    between: Transform[Nail, Nail] = reference.inverse() @ other
    return np.concatenate([between.rotation_vector_rad, between.translation_mm])


def moved_by(pose: Transform[Guide, Nail], motion: NDArray[np.float64]) -> Transform[Guide, Nail]:
    """The pose after a small motion of the nail in its own frame, shape (6,)."""
    step: Transform[Nail, Nail] = Transform.from_rotvec(motion[:3], motion[3:])
    return pose @ step


def cross_matrix(v: NDArray[np.float64]) -> NDArray[np.float64]:
    """The matrix that takes a vector to the cross product of `v` with it, shape (3, 3)."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


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
    nail_pose = RigidPose(camera_from_nail.rotation, camera_from_nail.translation_mm)
    rims_px = calibration.camera.project(nail_pose.points(rims))
    seen_nail = Correspondences(rims, rims_px, np.full(len(rims), 0.1))
    guide_pose = RigidPose(guide_fit.camera_from_guide.rotation, guide_fit.camera_from_guide.translation_mm)
    used = guide_fit.used
    balls = guide.balls.position_mm[used]
    seen_guide = Correspondences(
        balls, calibration.camera.project(guide_pose.points(balls)), guide_fit.standard_deviation_px[used]
    )
    found = []
    for camera in _cameras_with_other_sources(calibration):
        g, n = refine_pose(camera, guide_pose, seen_guide), refine_pose(camera, nail_pose, seen_nail)
        other_guide: Transform[Camera, Guide] = Transform.from_rotation_translation(g.rotation, g.translation_mm)
        other_nail: Transform[Camera, Nail] = Transform.from_rotation_translation(n.rotation, n.translation_mm)
        found.append(other_guide.inverse() @ other_nail)
    return tuple(found)


def _cameras_with_other_sources(calibration: CArmCalibration) -> tuple[PinholeCamera, ...]:
    """Cameras whose focal spot is moved by one standard deviation along the axes of its covariance.

    The image plane stays where it is, at the ring: a shift across the beam moves the principal point, one along the
    beam changes the focal length.
    """
    to_camera = calibration.camera_from_ring.rotation
    values, vectors = np.linalg.eigh(to_camera @ calibration.source_covariance_mm2 @ to_camera.T)
    px_per_mm = calibration.camera.focal_length_px / float(calibration.camera_from_ring.translation_mm[2])
    cameras = []
    for value, direction in zip(values, vectors.T, strict=True):
        x, y, z = np.sqrt(max(float(value), 0.0)) * direction * px_per_mm
        K = calibration.camera.intrinsic_matrix_px + np.array([[-z, 0.0, x], [0.0, -z, y], [0.0, 0.0, 0.0]])
        cameras.append(PinholeCamera(K))
    return tuple(cameras)


def _rim_points(nail: NailPart) -> NDArray[np.float64]:
    """Points on the circles where the holes meet the nail's surface, in the nail's frame, shape (K, 3), in mm."""
    return np.concatenate([_rims_of(nail, hole) for hole in nail.holes])


def _rims_of(nail: NailPart, hole: Hole) -> NDArray[np.float64]:
    angle = 2.0 * np.pi * np.arange(_RIM_POINTS) / _RIM_POINTS
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ across_basis(hole.axis.direction)
    return np.concatenate([end + 0.5 * hole.diameter_mm * circle for end in hole_surface_points(nail, hole)])
