"""Which poses to take images in, so that a handful determines best how the head holds the guide. Pure."""

import numpy as np
from numpy.typing import NDArray

from distalock.guide_calibration.noise import image_covariance, robot_covariance
from shared.geometry.hexapod import HexapodPart, PlatformPose, rotation_translation
from shared.geometry.hexapod_limits import limit_margins, within_limits

# Clear of the limits by more than the rounding of the suggested poses to 0.1, and than the robot's inaccuracy.
LEAST_LEG_MARGIN_MM, LEAST_JOINT_MARGIN_DEG = 0.3, 0.5
# As many as seconds allow: the choice is made once a calibration.
_TRIED, _CANDIDATES = 300_000, 1200
# The travel of each axis alone is about 19, 19, 8 mm and 16, 6, 14 degrees; together with others some reach further.
_SPREAD = np.array([20.0, 20.0, 16.0, 22.0, 18.0, 28.0])
# Exchanges end after a few rounds; this bounds them.
_MOST_ROUNDS = 10
# Nearer than this (millimetres and degrees) to a chosen pose the robot repeats its error: a pose there counts as
# if it left that many times the variance.
_APART, _RELUCTANCE = 10.0, 1000.0
_SEED = 7
# Tenths of degrees and millimetres, so that both count alike.
_UNIT = np.tile(np.repeat([np.radians(0.1), 0.1], 3), 2)
# A weak prior, 10 degrees and 10 mm, with which the first poses can be compared.
_KNOWN_BEFORE = 1e-4


def suggested_poses(hexapod: HexapodPart, head_extension_mm: float, count: int) -> list[PlatformPose]:
    """Poses for a guide calibration under a beam along the base's z axis, and one more in the middle to check it.

    Each next pose is the one, of many in the workspace, that leaves the least variance of the guide on its head; then
    each in turn is exchanged for a better one, until none is.

    Parameters
    ----------
    count
        Of images, the check included.
    """
    candidates = _candidates(hexapod)
    gains = _gains(hexapod, head_extension_mm, candidates)
    chosen: list[int] = []
    while len(chosen) < count - 1:
        chosen.append(_best(chosen, candidates, gains))
    for _ in range(_MOST_ROUNDS):
        before = list(chosen)
        for _ in before:
            chosen.append(_best(chosen[1:], candidates, gains))
            del chosen[0]
        if chosen == before:
            break
    return [*(PlatformPose.from_array(np.round(candidates[index], 1)) for index in chosen), hexapod.home_pose]


def _best(others: list[int], candidates: NDArray[np.float64], gains: NDArray[np.float64]) -> int:
    """Index of the pose that adds most information to others; near another, the robot's error is the same."""
    information = _KNOWN_BEFORE * np.eye(12) + gains[others].sum(axis=0)
    left = np.trace(np.linalg.inv(information + gains)[:, :6, :6], axis1=1, axis2=2)
    for other in others:
        left[np.linalg.norm(candidates - candidates[other], axis=1) < _APART] *= _RELUCTANCE
    return int(np.argmin(left))


def _candidates(hexapod: HexapodPart) -> NDArray[np.float64]:
    """Poses well within the limits that turn the platform most, shape (N, 6)."""
    tried = np.random.default_rng(_SEED).uniform(-1.0, 1.0, (_TRIED, 6)) * _SPREAD
    inside = tried[within_limits(hexapod, tried, hexapod.pivot_mm)]
    leg_mm, joint_deg = limit_margins(hexapod, inside, hexapod.pivot_mm)
    clear = inside[(leg_mm > LEAST_LEG_MARGIN_MM) & (joint_deg > LEAST_JOINT_MARGIN_DEG)]
    return np.asarray(clear[np.argsort(-np.linalg.norm(clear[:, 3:], axis=1))][:_CANDIDATES])


def _gains(hexapod: HexapodPart, head_extension_mm: float, poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Information that a view in each pose adds about hand-eye and robot-world, shape (N, 12, 12), in `_UNIT`."""
    head = hexapod.top_from_guide(head_extension_mm)
    turned, shifted_mm = rotation_translation(hexapod, poses, hexapod.pivot_mm)
    rotation = turned @ head.rotation
    derivatives = _UNIT * _derivatives(rotation, turned @ head.translation_mm + shifted_mm)
    weights = np.linalg.inv(image_covariance(rotation) + robot_covariance())
    return np.asarray(np.swapaxes(derivatives, -1, -2) @ weights @ derivatives)


def _derivatives(rotation: NDArray[np.float64], place_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """How the guide, in its own frame, moves with small steps of hand-eye and robot-world, shape (N, 6, 12).

    Parameters
    ----------
    rotation, place_mm
        Of the guide in the base, shapes (N, 3, 3) and (N, 3).
    """
    back = np.swapaxes(rotation, -1, -2)
    derivatives = np.zeros((len(rotation), 6, 12))
    derivatives[:, :, :6] = np.eye(6)
    derivatives[:, :3, 6:9] = derivatives[:, 3:, 9:] = back
    # back @ (step x place), column by column
    derivatives[:, 3:, 6:9] = back @ np.swapaxes(np.cross(np.eye(3), place_mm[:, None]), -1, -2)
    return derivatives
