"""Which poses to take images in, so that a handful of them says most about how the head holds the guide. Pure."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform

from services.robot.core.guide_calibration import moved, robot_covariance
from shared.geometry.hexapod import HexapodPart, PlatformPose, base_from_top
from shared.geometry.hexapod_limits import limit_margins, within_limits

# What one image is good for: tilts, turn (rad), across the beam, along the beam (mm).
IMAGE_SD = np.array([np.radians(0.03), np.radians(0.03), np.radians(0.012), 0.02, 0.02, 0.15])
LEAST_LEG_MARGIN_MM, LEAST_JOINT_MARGIN_DEG = 0.3, 0.5
_TRIED, _CANDIDATES = 300_000, 1200
_SPREAD = np.array([20.0, 20.0, 16.0, 22.0, 18.0, 28.0])
_STEP = 1e-5
_SEED = 7


def suggested_poses(hexapod: HexapodPart, head_extension_mm: float, count: int) -> list[PlatformPose]:
    """Poses for a guide calibration, and one more in the middle to check it.

    Greedy: each next pose is the one, of many in the workspace, that leaves the least variance.

    Parameters
    ----------
    count
        Of images, the check included.
    """
    candidates = _candidates(hexapod)
    hand = hexapod.top_from_guide(head_extension_mm).rigid
    whitening = np.linalg.inv(np.linalg.cholesky(np.diag(IMAGE_SD**2) + robot_covariance()))
    derivatives = np.array([whitening @ _derivatives(hexapod, hand, pose) for pose in candidates])
    gains = np.einsum("nij,nik->njk", derivatives, derivatives)
    # In tenths of degrees and millimetres, so that both count alike.
    unit = np.diag(np.tile(np.repeat([np.radians(0.1), 0.1], 3), 2))
    information = unit @ (1e-6 * np.eye(12)) @ unit + 1e-4 * np.eye(12)
    chosen = []
    for _ in range(count - 1):
        left = np.linalg.inv(information + unit @ gains @ unit)[:, :6, :6]
        best = int(np.argmin(np.trace(left, axis1=1, axis2=2)))
        information = information + unit @ gains[best] @ unit
        chosen.append(PlatformPose.from_array(np.round(candidates[best], 1)))
    return [*chosen, hexapod.home_pose]


def _candidates(hexapod: HexapodPart) -> NDArray[np.float64]:
    """Poses well within the limits that turn the platform most, shape (N, 6)."""
    tried = np.random.default_rng(_SEED).uniform(-1.0, 1.0, (_TRIED, 6)) * _SPREAD
    inside = tried[within_limits(hexapod, tried, hexapod.pivot_mm)]
    leg_mm, joint_deg = limit_margins(hexapod, inside, hexapod.pivot_mm)
    clear = inside[(leg_mm > LEAST_LEG_MARGIN_MM) & (joint_deg > LEAST_JOINT_MARGIN_DEG)]
    return np.asarray(clear[np.argsort(-np.linalg.norm(clear[:, 3:], axis=1))][:_CANDIDATES])


def _derivatives(hexapod: HexapodPart, hand: RigidTransform, pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """How the guide, as seen in its own frame, moves with small steps of hand-eye and robot-world, shape (6, 12)."""
    platform = base_from_top(hexapod, PlatformPose.from_array(pose), hexapod.pivot_mm).rigid
    here = platform * hand
    world = RigidTransform.identity()
    columns = []
    for column in range(12):
        step = np.zeros(6)
        step[column % 6] = _STEP
        there = platform * moved(hand, step) if column < 6 else moved(world, step) * here
        off = here.inv() * there
        columns.append(np.concatenate([off.rotation.as_rotvec(), off.translation]) / _STEP)
    return np.stack(columns, axis=-1)
