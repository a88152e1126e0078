"""The nail's hole axes in the guide's frame, with what guide, nail and C-arm calibration leave uncertain."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.alignment import hole_tilts
from services.registration.core.guide import GuideFit
from services.registration.core.passing import AxisOffset, across_basis
from services.registration.core.pose import Correspondences, RigidPose, refine_pose
from shared.geometry.calibration import CArmCalibration
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.lines import Line, unit
from shared.geometry.parts import GuidePart, Hole, NailPart, hole_surface_points
from shared.geometry.transform import Transform

# What is left of the model's own errors after all that the fit floats: standard deviation of the tilt about the nail's
# x and y axes, and of its place across the beam, from independent images and own scenes.
MODEL_SD_DEG = 0.04
MODEL_SD_MM = 0.02
_RIM_POINTS = 8


@dataclass(frozen=True, slots=True)
class Misfit:
    """How far the fitted model had to depart from the part, and what it left unexplained.

    Attributes
    ----------
    hole_radius_excess_mm, nail_radius_excess_mm
        Fitted radii less those of the nail's file.
    structure
        Residual at rims and edges over that elsewhere; one when only noise is left.
    """

    hole_radius_excess_mm: float
    nail_radius_excess_mm: float
    structure: float


@dataclass(frozen=True, slots=True, eq=False)
class NailEstimate:
    """The nail in the camera's frame, whichever method found it.

    Attributes
    ----------
    camera_from_nail
        Pose of the nail.
    covariance
        Shape (6, 6), of a small rotation (rad) and translation (mm) in the nail's own frame, as `GuideFit.covariance`;
        None for a method that does not know its errors.
    mirror_margin
        How much worse the best mirrored pose explains the pixels; None for methods without one.
    misfit
        What speaks against the model; None for methods that fit none.
    """

    camera_from_nail: Transform[Camera, Nail]
    covariance: NDArray[np.float64] | None
    mirror_margin: float | None
    misfit: Misfit | None


@dataclass(frozen=True, slots=True, eq=False)
class HoleEstimate:
    """One nail hole in the guide's frame.

    Attributes
    ----------
    axis_guide
        The hole's axis, directed along drilling, through its entry.
    entry_guide_mm, exit_guide_mm
        Where the axis enters and leaves the nail, shape (3,).
    diameter_mm
        Of the hole, from the nail's file.
    tilt_to_ray_deg
        Angle between the axis and the ray through the hole's middle.
    offset
        Error of the axis: mean zero, with its covariance; None when the method does not know its errors.
    """

    id: str
    axis_guide: Line
    entry_guide_mm: NDArray[np.float64]
    exit_guide_mm: NDArray[np.float64]
    diameter_mm: float
    tilt_to_ray_deg: float
    offset: AxisOffset | None

    @property
    def chance_to_pass(self) -> float | None:
        """Probability that a 4.0 mm drill along the estimated axis passes the true hole."""
        return None if self.offset is None else self.offset.chance_to_pass(self.diameter_mm)


def model_covariance(nail: NailPart, camera_from_nail: Transform[Camera, Nail]) -> NDArray[np.float64]:
    """What the model itself leaves uncertain, shape (6, 6), as `NailEstimate.covariance`.

    The depth follows from the distance of the outermost holes, or the nail's width where there is but one hole: that
    distance is off by as much as the nail's place, and depth is to its error as the distance is to its own. An error of
    depth moves the nail along the ray, and so across its holes when they are tilted against it.
    """
    along = [float(hole.axis.point_mm[0]) for hole in nail.holes]
    known_mm = max(max(along) - min(along), nail.diameter_mm)
    depth_sd_mm = MODEL_SD_MM * float(camera_from_nail.translation_mm[2]) / known_mm
    ray = camera_from_nail.rotation.T @ unit(camera_from_nail.translation_mm)
    covariance = np.diag([np.radians(MODEL_SD_DEG) ** 2] * 2 + [0.0] + [MODEL_SD_MM**2] * 2 + [0.0])
    covariance[3:, 3:] += depth_sd_mm**2 * np.outer(ray, ray)
    return covariance


def hole_estimates(
    calibration: CArmCalibration, guide: GuidePart, nail: NailPart, guide_fit: GuideFit, estimate: NailEstimate
) -> tuple[HoleEstimate, ...]:
    """All holes of the nail in the guide's frame, in the order of the nail's file."""
    guide_from_nail = guide_fit.camera_from_guide.inverse() @ estimate.camera_from_nail
    tilts = hole_tilts(estimate.camera_from_nail, nail)
    shifted = _poses_for_other_sources(calibration, guide, nail, guide_fit, estimate)
    estimates = []
    for hole, tilt in zip(nail.holes, tilts, strict=True):
        entry, leaving = hole_surface_points(nail, hole)
        axis = Line(guide_from_nail @ entry, guide_from_nail.directions(hole.axis.direction))
        offset = None
        if estimate.covariance is not None:
            ends = np.stack([entry, leaving])
            covariance = _pose_part(guide_from_nail, ends, axis, guide_fit.covariance, estimate.covariance)
            covariance = covariance + _source_part(guide_from_nail, ends, axis, shifted)
            offset = AxisOffset(np.zeros(4), covariance, float(np.linalg.norm(leaving - entry)))
        estimates.append(
            HoleEstimate(
                hole.id,
                axis,
                axis.point_mm,
                guide_from_nail @ leaving,
                hole.diameter_mm,
                tilt.tilt_to_ray_deg,
                offset,
            )
        )
    return tuple(estimates)


def _cross_matrix(v: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _pose_part(
    guide_from_nail: Transform[Guide, Nail],
    ends_nail_mm: NDArray[np.float64],
    axis_guide: Line,
    guide_covariance: NDArray[np.float64],
    nail_covariance: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Covariance of the offsets at entry and exit, shape (4, 4), from the covariances of both poses.

    A small motion (w, t) of a body in its own frame moves its point x by w x x + t. In the guide's frame the nail's
    point moves with the nail, and against the guide's own motion.
    """
    across = across_basis(axis_guide.direction)
    by_nail, by_guide = [], []
    for end in ends_nail_mm:
        by_nail.append(across @ guide_from_nail.rotation @ np.hstack([-_cross_matrix(end), np.eye(3)]))
        by_guide.append(-across @ np.hstack([-_cross_matrix(guide_from_nail @ end), np.eye(3)]))
    J_nail, J_guide = np.vstack(by_nail), np.vstack(by_guide)
    return np.asarray(J_nail @ nail_covariance @ J_nail.T + J_guide @ guide_covariance @ J_guide.T)


def _source_part(
    guide_from_nail: Transform[Guide, Nail],
    ends_nail_mm: NDArray[np.float64],
    axis_guide: Line,
    shifted: tuple[Transform[Guide, Nail], ...],
) -> NDArray[np.float64]:
    """Covariance of the offsets, shape (4, 4), from one standard deviation of the focal spot in three directions."""
    across = across_basis(axis_guide.direction)
    covariance = np.zeros((4, 4))
    for other in shifted:
        offset = ((other.points(ends_nail_mm) - guide_from_nail.points(ends_nail_mm)) @ across.T).ravel()
        covariance += np.outer(offset, offset)
    return covariance


def _poses_for_other_sources(
    calibration: CArmCalibration, guide: GuidePart, nail: NailPart, guide_fit: GuideFit, estimate: NailEstimate
) -> tuple[Transform[Guide, Nail], ...]:
    """What `guide_from_nail` would be if the focal spot lay one standard deviation elsewhere.

    The image stays as it is: guide and nail are fitted again, to the same pixels, by the camera with the other source.
    Of the nail the rims of its holes are taken, because they carry its pose.
    """
    rims = _rim_points(nail)
    nail_pose = RigidPose(estimate.camera_from_nail.rotation, estimate.camera_from_nail.translation_mm)
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
        camera_from_guide: Transform[Camera, Guide] = Transform.from_rotation_translation(g.rotation, g.translation_mm)
        camera_from_nail: Transform[Camera, Nail] = Transform.from_rotation_translation(n.rotation, n.translation_mm)
        found.append(camera_from_guide.inverse() @ camera_from_nail)
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
