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

from services.registration.core.compiled import compiled
from services.registration.core.estimation.pose_estimate import POSE_SIZE
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Nail
from shared.geometry.lines import unit
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform

_MOST_DEVIATIONS = 6.0
_RADIUS_EXCESS_BOUND_MM = 0.6

_MINIMAL_ANCHOR_DISTANCE_MM = 5.0
_DEFAULT_ANCHOR_MM = 15.0
_STEP = np.array([0.01, 0.01, 0.01, 0.01, 1e-4, 1e-4])


class Parameter(IntEnum):
    """Place of each unknown in the parameter vector; the first six are the pose."""

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
    DELRIN_PER_MM = 18


PARAMETER_COUNT = len(Parameter)


# What the nail's file says of the nail, more or less: it is the same in every image of that nail.
SHAPE_PARAMETERS = (Parameter.HOLE_RADIUS_EXCESS_MM, Parameter.NAIL_RADIUS_EXCESS_MM, Parameter.CHAMFER_DEVIATIONS)


# Mean and standard deviation of what is known before the image is seen. Attenuation: the mean of the X-rays that pass
# 100-200 mm of muscle at 60-80 kV; hardening: `attenuation.py`.
ATTENUATION_PER_MM = {"steel": 1.6, "Ti6Al4V": 0.5}


# Rims are at least deburred. An image hardly shows by how much, and a tilt is off by a tenth of what a chamfer hides of
# the bore's length: so the files of nails should say it.
USUAL_CHAMFER_MM, USUAL_CHAMFER_SD_MM, STATED_CHAMFER_SD_MM = 0.15, 0.15, 0.05


STEEL_IN_NAIL_MATERIAL = {"steel": 1.0, "Ti6Al4V": 3.2}


PRIOR = {
    Parameter.HOLE_RADIUS_EXCESS_MM: (0.0, 0.03),
    Parameter.NAIL_RADIUS_EXCESS_MM: (0.0, 0.03),
    Parameter.CHAMFER_DEVIATIONS: (0.0, 1.0),
    Parameter.LOG_ATTENUATION: (0.0, 0.5),
    Parameter.HARDENING: (0.65, 0.3),
    Parameter.LOG_BLUR_PX: (float(np.log(1.2)), 0.35),
    Parameter.TAIL_SHARE: (0.2, 0.15),
    Parameter.LOG_TAIL_WIDTH: (float(np.log(2.2)), 0.2),
    Parameter.SHARPENING: (0.2, 0.4),
    Parameter.LOG_SHARPENING_WIDTH_PX: (float(np.log(2.5)), 0.4),
    Parameter.CURVE: (0.3, 0.3),
    Parameter.CURVE_EXPONENT: (0.4, 0.25),
    Parameter.DELRIN_PER_MM: (0.02, 0.02),
}


# Displays lie between logarithmic (0) and linear (1, where the curve would have no bend left).
_LEAST_EXPONENT, _MOST_EXPONENT = -0.4, 0.9


_MOST_TAIL = 0.8


_RADII = (Parameter.HOLE_RADIUS_EXCESS_MM, Parameter.NAIL_RADIUS_EXCESS_MM)


def _reach_of(unknown: Parameter) -> float:
    """How far from its prior's mean a parameter may go; radii far enough to tell another nail."""
    if unknown not in PRIOR:
        return float("inf")
    return _RADIUS_EXCESS_BOUND_MM if unknown in _RADII else _MOST_DEVIATIONS * PRIOR[unknown][1]


_REACH = np.array([_reach_of(unknown) for unknown in Parameter])


_MEAN = np.array([PRIOR[u][0] if u in PRIOR else 0.0 for u in Parameter])


_PRECISION = np.array([PRIOR[u][1] ** -2 if u in PRIOR else 0.0 for u in Parameter])


def prior_mean() -> NDArray[np.float64]:
    """Shape (PARAMETER_COUNT,); zero for the pose."""
    return _MEAN.copy()


def prior_precision() -> NDArray[np.float64]:
    """Inverse variances, shape (PARAMETER_COUNT,); zero for the pose."""
    return _PRECISION.copy()


def clipped_to_bounds(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
    """Nuisances clipped to where they still mean something, mostly six standard deviations of their prior."""
    clipped = np.clip(parameters, prior_mean() - _REACH, prior_mean() + _REACH)
    exponent = Parameter.CURVE_EXPONENT
    clipped[exponent] = np.clip(clipped[exponent], _LEAST_EXPONENT, _MOST_EXPONENT)
    clipped[Parameter.HARDENING] = max(clipped[Parameter.HARDENING], 0.0)
    # below, the curve is straight and nothing would tell the way back
    clipped[Parameter.CURVE] = max(clipped[Parameter.CURVE], 0.0)
    clipped[Parameter.TAIL_SHARE] = np.clip(clipped[Parameter.TAIL_SHARE], 0.0, _MOST_TAIL)
    return np.asarray(clipped)


@dataclass(frozen=True, slots=True)
class Anchors:
    """Places on the nail's axis whose images carry the pose, as x in the nail's frame (first < second), in mm."""

    first_x_mm: float
    second_x_mm: float


def anchors_of(nail: NailPart) -> Anchors:
    """Outermost hole positions, or 15 mm on either side of the origin when the holes are closer than 5 mm."""
    along = [float(hole.axis.point_mm[0]) for hole in nail.holes]
    if max(along) - min(along) < _MINIMAL_ANCHOR_DISTANCE_MM:
        return Anchors(-_DEFAULT_ANCHOR_MM, _DEFAULT_ANCHOR_MM)
    return Anchors(min(along), max(along))


def pose_from_parameters(
    parameters: NDArray[np.float64], camera: PinholeCamera, anchors: Anchors
) -> Transform[Camera, Nail]:
    """Pose from (first anchor x, y, second anchor x, y in ideal px, pitch, roll in rad), shape (6,)."""
    return Transform.from_rotation_translation(*rotation_and_translation(parameters, camera, anchors))


@compiled
def _norm(vector: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.sum(vector * vector)))


@compiled
def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@compiled
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
