"""Parameters of the fit: the nail's pose and the nuisance parameters, their order, bounds and priors.

The pose is given by image points and tilts, in which the fit is well conditioned. Two *anchors* on the nail's axis (at
the outermost hole positions) project to two ideal pixels; `pitch` turns the nail about its own y axis away from the
plane across the mean ray, `roll` turns it about its own axis. The reflection of a tilt is then a change of sign of
pitch or roll, with the anchors where they are.
"""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.pose_estimate import POSE_SIZE
from services.registration.core.tuning import BENT_NAIL, NAIL_PRIORS
from shared.compiled import compiled, compiled_inline
from shared.geometry.bend import MM_PER_M
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import unit
from shared.geometry.parts import NailPart, mean_hole_direction
from shared.geometry.transform import Transform
from shared.xray.pixel_scale import USUAL_PIXEL_MM, pixels

# Steps of central differences: exact to a part in a million.
_STEP = np.array([0.01, 0.01, 0.01, 0.01, 1e-4, 1e-4])


class Parameter(IntEnum):
    """Place of each parameter in the vector; the first six are the pose, the others nuisance parameters.

    Widths of blur and edge enhancement are in pixels of the usual pitch at the detector.
    """

    FIRST_X_PX = 0
    FIRST_Y_PX = 1
    SECOND_X_PX = 2
    SECOND_Y_PX = 3
    PITCH_RAD = 4
    ROLL_RAD = 5
    HOLE_RADIUS_EXCESS_MM = 6
    NAIL_RADIUS_EXCESS_MM = 7
    CHAMFER_DEVIATIONS = 8
    LOG_ATTENUATION = 9
    HARDENING = 10
    LOG_BLUR_PX = 11
    TAIL_SHARE = 12
    LOG_TAIL_WIDTH = 13
    SHARPENING = 14
    LOG_SHARPENING_WIDTH_PX = 15
    CURVE = 16
    CURVE_EXPONENT = 17
    BULGE = 18
    S_BEND = 19
    DELRIN_PER_MM = 20
    BEND_Y_PER_M = 21
    BEND_Z_PER_M = 22


PARAMETER_COUNT = len(Parameter)
CURVATURE = [Parameter.BEND_Y_PER_M, Parameter.BEND_Z_PER_M]
# All but the curvature, which stays zero.
STRAIGHT_NAIL = ~np.isin(np.arange(PARAMETER_COUNT), CURVATURE)
POSE_ONLY = np.arange(PARAMETER_COUNT) < POSE_SIZE
# What the display does beyond a power of the intensity; plain images are fitted without.
DISPLAY_BENDS = [Parameter.BULGE, Parameter.S_BEND]
STRAIGHT_DISPLAY = STRAIGHT_NAIL & ~np.isin(np.arange(PARAMETER_COUNT), DISPLAY_BENDS)
TILTS = [Parameter.PITCH_RAD, Parameter.ROLL_RAD]
# Deviations from the part file: the same in every image of one nail.
SHAPE_PARAMETERS = (
    Parameter.HOLE_RADIUS_EXCESS_MM,
    Parameter.NAIL_RADIUS_EXCESS_MM,
    Parameter.CHAMFER_DEVIATIONS,
    Parameter.BEND_Y_PER_M,
    Parameter.BEND_Z_PER_M,
)
_RADII = [Parameter.HOLE_RADIUS_EXCESS_MM, Parameter.NAIL_RADIUS_EXCESS_MM]


def priors() -> dict[Parameter, tuple[float, float]]:
    """Mean and standard deviation of each nuisance parameter before an image is seen."""
    p = NAIL_PRIORS
    return {
        Parameter.HOLE_RADIUS_EXCESS_MM: (0.0, p.radius_sd_mm),
        Parameter.NAIL_RADIUS_EXCESS_MM: (0.0, p.radius_sd_mm),
        Parameter.CHAMFER_DEVIATIONS: (0.0, 1.0),
        Parameter.LOG_ATTENUATION: (0.0, p.log_attenuation_sd),
        Parameter.HARDENING: (p.hardening, p.hardening_sd),
        Parameter.LOG_BLUR_PX: (_log_usual_px(p.blur_detector_mm), p.log_blur_sd),
        Parameter.TAIL_SHARE: (p.tail_share, p.tail_share_sd),
        Parameter.LOG_TAIL_WIDTH: (float(np.log(p.tail_width)), p.log_tail_width_sd),
        Parameter.SHARPENING: (p.sharpening, p.sharpening_sd),
        Parameter.LOG_SHARPENING_WIDTH_PX: (_log_usual_px(p.sharpening_detector_mm), p.log_sharpening_width_sd),
        Parameter.CURVE: (p.curve, p.curve_sd),
        Parameter.CURVE_EXPONENT: (p.curve_exponent, p.curve_exponent_sd),
        Parameter.BULGE: (0.0, p.bulge_sd),
        Parameter.S_BEND: (0.0, p.s_bend_sd),
        Parameter.DELRIN_PER_MM: (p.delrin_per_mm, p.delrin_per_mm_sd),
        Parameter.BEND_Y_PER_M: (0.0, p.bent_sd_per_m),
        Parameter.BEND_Z_PER_M: (0.0, p.bent_sd_per_m),
    }


def _log_usual_px(length_detector_mm: float) -> float:
    # Rounded to whole decimals of a pixel: a blur off by a last digit may have a kernel longer by one.
    return float(np.log(pixels(length_detector_mm, USUAL_PIXEL_MM)))


def prior_mean() -> NDArray[np.float64]:
    """Shape (PARAMETER_COUNT,); zero for the pose."""
    return np.array([0.0] * POSE_SIZE + [mean for mean, _ in priors().values()])


def prior_precision() -> NDArray[np.float64]:
    """Inverse variances, shape (PARAMETER_COUNT,); zero for the pose."""
    return np.array([0.0] * POSE_SIZE + [deviation**-2 for _, deviation in priors().values()])


def clipped_to_bounds(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """Nuisance parameters clipped to where the model holds, most to six standard deviations of their prior.

    The curvature keeps its direction. In a nail that is bent into a coil each ray has a cross-section of its own.
    """
    mean, reach = prior_mean(), np.full(PARAMETER_COUNT, np.inf)
    reach[POSE_SIZE:] = [NAIL_PRIORS.largest_deviations * deviation for _, deviation in priors().values()]
    reach[_RADII], reach[CURVATURE] = NAIL_PRIORS.largest_radius_excess_mm, np.inf
    clipped = np.clip(parameters, mean - reach, mean + reach)
    exponent, tail = Parameter.CURVE_EXPONENT, Parameter.TAIL_SHARE
    clipped[exponent] = np.clip(clipped[exponent], NAIL_PRIORS.least_exponent, NAIL_PRIORS.largest_exponent)
    clipped[Parameter.HARDENING] = max(clipped[Parameter.HARDENING], 0.0)
    # below zero the curve is straight: no derivative would lead back
    clipped[Parameter.CURVE] = max(clipped[Parameter.CURVE], 0.0)
    clipped[tail] = np.clip(clipped[tail], 0.0, NAIL_PRIORS.largest_tail_share)
    largest_per_m = MM_PER_M / BENT_NAIL.bound_radius_mm
    clipped[CURVATURE] *= min(1.0, largest_per_m / max(float(np.hypot(*clipped[CURVATURE])), largest_per_m))
    return np.asarray(clipped)


def level_tilts(nail: NailPart) -> NDArray[np.float64]:
    """Pitch and roll with which the holes' mean axis lies along the mean ray, shape (2,); zero of usual nails.

    A tilt of the holes is counted from there, and so its reflection.
    """
    x, y, z = mean_hole_direction(nail)
    return np.array([np.arctan2(x, np.hypot(y, z)), np.arctan2(y, z)])


def curvature_of(parameters: NDArray[np.float64]) -> tuple[float, float]:
    """Curvature towards the nail's y and z in 1/m."""
    return float(parameters[Parameter.BEND_Y_PER_M]), float(parameters[Parameter.BEND_Z_PER_M])


def chamfer(nail: NailPart, parameters: NDArray[np.float64]) -> tuple[float, float]:
    """Depth of the holes' chamfers in mm, and its derivative by the parameter; both 0 where no chamfer is left.

    An image hardly determines the depth, and a tilt is off by a tenth of what a chamfer hides of the bore's length:
    part files should state it.
    """
    stated = [hole.chamfer_mm for hole in nail.holes if hole.chamfer_mm is not None]
    mean, deviation = NAIL_PRIORS.usual_chamfer_mm, NAIL_PRIORS.usual_chamfer_sd_mm
    if len(stated) == len(nail.holes):
        mean, deviation = float(np.mean(stated)), NAIL_PRIORS.stated_chamfer_sd_mm
    depth_mm = mean + deviation * float(parameters[Parameter.CHAMFER_DEVIATIONS])
    return (depth_mm, deviation) if depth_mm > 0.0 else (0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Anchors:
    """Places on the nail's axis whose images carry the pose, as x in the nail's frame (first < second), in mm."""

    first_x_mm: float
    second_x_mm: float


def anchors_of(nail: NailPart) -> Anchors:
    """Outermost hole positions, or 15 mm on either side of the origin when the holes are closer than 5 mm."""
    along = [float(hole.axis.point_mm[0]) for hole in nail.holes]
    if max(along) - min(along) < NAIL_PRIORS.least_anchor_distance_mm:
        return Anchors(-NAIL_PRIORS.usual_anchor_mm, NAIL_PRIORS.usual_anchor_mm)
    return Anchors(min(along), max(along))


def pose_from_parameters(
    parameters: NDArray[np.float64], camera: PinholeCamera, anchors: Anchors
) -> Transform[Camera, Nail]:
    """Pose from (first anchor x, y, second anchor x, y in ideal px, pitch, roll in rad), shape (6,)."""
    return Transform.from_rotation_translation(*rotation_and_translation(parameters, camera, anchors))


@compiled_inline
def _norm(vector: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.sum(vector * vector)))


@compiled_inline
def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@compiled_inline
def _ray(x_px: float, y_px: float, intrinsic_matrix_px: NDArray[np.float64]) -> NDArray[np.float64]:
    """As `PinholeCamera.rays`, for one pixel."""
    y = (y_px - intrinsic_matrix_px[1, 2]) / intrinsic_matrix_px[1, 1]
    x = (x_px - intrinsic_matrix_px[0, 2] - intrinsic_matrix_px[0, 1] * y) / intrinsic_matrix_px[0, 0]
    direction = np.array([x, y, 1.0])
    return np.asarray(direction / _norm(direction))


@compiled
def _place(
    parameters: NDArray[np.float64],
    intrinsic_matrix_px: NDArray[np.float64],
    ends_mm: tuple[float, float],
    rotation: NDArray[np.float64],
    translation_mm: NDArray[np.float64],
) -> None:
    """Poses of parameters, shape (K, 6), into shapes (K, 3, 3) and (K, 3)."""
    distance_mm = ends_mm[1] - ends_mm[0]
    for k in range(parameters.shape[0]):
        first = _ray(parameters[k, 0], parameters[k, 1], intrinsic_matrix_px)
        second = _ray(parameters[k, 2], parameters[k, 3], intrinsic_matrix_px)
        pitch, roll = parameters[k, 4], parameters[k, 5]
        half_angle = np.arctan2(_norm(second - first), _norm(second + first))
        total = distance_mm * np.cos(pitch) / np.sin(half_angle)
        difference = distance_mm * np.sin(pitch) / np.cos(half_angle)
        near_end = 0.5 * (total - difference) * first
        x = 0.5 * (total + difference) * second - near_end
        x = x / _norm(x)
        middle = first + second
        level = middle - x * np.sum(middle * x)
        level = level / _norm(level)
        z = np.cos(roll) * level - np.sin(roll) * _cross(level, x)
        rotation[k, :, 0], rotation[k, :, 1], rotation[k, :, 2] = x, _cross(z, x), z
        translation_mm[k] = near_end - ends_mm[0] * x


def rotation_and_translation(
    parameters: NDArray[np.float64], camera: PinholeCamera, anchors: Anchors
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The same poses as bare arrays, shapes (..., 6) to (..., 3, 3) and (..., 3), for the inner loop: no checks."""
    shape = parameters.shape[:-1]
    flat = np.ascontiguousarray(parameters.reshape(-1, POSE_SIZE))
    rotation, translation_mm = np.empty((len(flat), 3, 3)), np.empty((len(flat), 3))
    ends_mm = anchors.first_x_mm, anchors.second_x_mm
    _place(flat, camera.intrinsic_matrix_px, ends_mm, rotation, translation_mm)
    return rotation.reshape(*shape, 3, 3), translation_mm.reshape(*shape, 3)


def motion_by_parameters(
    parameters: NDArray[np.float64], camera: PinholeCamera, anchors: Anchors
) -> NDArray[np.float64]:
    """Small motion of the nail in its own frame by pose parameter, shape (6, 6): rotation (rad), translation (mm).

    The pose for parameters p + dp is `camera_from_nail(p) @ motion`.
    """
    steps = np.diag(_STEP)
    poses = np.stack([parameters, *(parameters + steps), *(parameters - steps)])
    rotation, translation_mm = rotation_and_translation(poses, camera, anchors)
    turns = rotation[0].T @ (rotation[1 : POSE_SIZE + 1] - rotation[POSE_SIZE + 1 :])
    shifts = (translation_mm[1 : POSE_SIZE + 1] - translation_mm[POSE_SIZE + 1 :]) @ rotation[0]
    skew = 0.5 * (turns - turns.swapaxes(-1, -2))
    vectors = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=-1)
    return np.asarray((np.concatenate([vectors, shifts], axis=-1) / (2.0 * _STEP[:, None])).T)


def parameters_from_pose(
    camera_from_nail: Transform[Camera, Nail], camera: PinholeCamera, anchors: Anchors
) -> NDArray[np.float64]:
    """Inverse of `pose_from_parameters`, shape (6,)."""
    ends = camera_from_nail.points(np.array([[anchors.first_x_mm, 0.0, 0.0], [anchors.second_x_mm, 0.0, 0.0]]))
    directions = unit(ends)
    middle = unit(directions[0] + directions[1])
    x, _, z = camera_from_nail.rotation.T
    level = unit(middle - x * float(middle @ x))
    y_level = np.cross(level, x)
    pitch = np.arctan2(float(x @ middle), float(np.linalg.norm(np.cross(x, middle))))
    roll = np.arctan2(-float(z @ y_level), float(z @ level))
    return np.concatenate([camera.project(ends).ravel(), [pitch, roll]])
