"""The space in which the hexapod can work: travel of each axis, and a map of where it can stand and tilt."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from shared.geometry.hexapod import HexapodPart, PlatformPose
from shared.geometry.hexapod_limits import within_limits

UNREACHABLE = -1.0
# The golden angle spreads directions evenly over the sphere; blocks bound the memory.
_GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))
_POSES_AT_ONCE = 65536


@dataclass(frozen=True, slots=True, eq=False)
class WorkspaceMap:
    """Where the pivot can be, and how far the platform can be tilted and turned there in every direction.

    Attributes
    ----------
    x_mm, y_mm, z_mm
        The grid, shapes (I,), (J,) and (K,).
    free_tilt_deg
        The largest tried angle up to which every tried rotation is within the limits, shape (I, J, K); 0 where the
        robot can stand level but not tilt, `UNREACHABLE` where not even that.
    poses
        How many poses were checked.
    """

    x_mm: NDArray[np.float64]
    y_mm: NDArray[np.float64]
    z_mm: NDArray[np.float64]
    free_tilt_deg: NDArray[np.float64]
    poses: int

    def volume_mm3(self, tilt_deg: float) -> float:
        """Volume in which every rotation up to `tilt_deg` is possible (0: standing level), in cubic millimetres."""
        cell = float(np.prod([axis[1] - axis[0] for axis in (self.x_mm, self.y_mm, self.z_mm)]))
        return cell * int(np.count_nonzero(self.free_tilt_deg >= tilt_deg))


def workspace_map(
    hexapod: HexapodPart,
    pivot_mm: NDArray[np.float64],
    grid_mm: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
    angles_deg: NDArray[np.float64],
    directions: int,
) -> WorkspaceMap:
    """Look at every position of a grid, level and turned about many axes by several angles.

    Parameters
    ----------
    pivot_mm
        Centre of rotation in the top's frame, shape (3,): the point whose positions the grid means.
    grid_mm
        Displacements of the pivot from its place in the zero pose, along x, y and z: three increasing arrays.
    angles_deg
        Angles of rotation to try, increasing, shape (A,).
    directions
        How many axes of rotation to try, evenly spread over all directions.
    """
    positions = np.stack(np.meshgrid(*grid_mm, indexing="ij"), axis=-1).reshape(-1, 3)
    rotations = _rotations_deg(angles_deg, directions)
    free_tilt = np.full(len(positions), UNREACHABLE)
    step = max(_POSES_AT_ONCE // len(rotations), 1)
    for begin in range(0, len(positions), step):
        here = positions[begin : begin + step]
        poses = np.empty((len(here), len(rotations), 6))
        poses[..., :3], poses[..., 3:] = here[:, None, :], rotations
        inside = within_limits(hexapod, poses, pivot_mm)
        free_tilt[begin : begin + step] = _free_tilt_deg(inside, angles_deg)
    shape = [len(axis) for axis in grid_mm]
    return WorkspaceMap(*grid_mm, free_tilt.reshape(shape), len(positions) * len(rotations))


def _rotations_deg(angles_deg: NDArray[np.float64], directions: int) -> NDArray[np.float64]:
    """U V W of no rotation, then of all axes by the first angle, by the second, and so on; shape (1 + A D, 3)."""
    index = np.arange(directions)
    z = 1.0 - (2.0 * index + 1.0) / directions
    ring = np.sqrt(1.0 - z**2)
    axes = np.stack([ring * np.cos(_GOLDEN_ANGLE * index), ring * np.sin(_GOLDEN_ANGLE * index), z], axis=-1)
    vectors = np.radians(angles_deg)[:, None, None] * axes
    turned = Rotation.from_rotvec(vectors.reshape(-1, 3)).as_euler("XYZ", degrees=True)
    return np.concatenate([np.zeros((1, 3)), turned])


def _free_tilt_deg(inside: NDArray[np.bool_], angles_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """From which poses are within the limits, shape (N, 1 + A D), to the largest free angle, shape (N,)."""
    level = inside[:, :1]
    all_directions = inside[:, 1:].reshape(len(inside), len(angles_deg), -1).all(axis=-1)
    steps = np.logical_and.accumulate(np.concatenate([level, all_directions], axis=1), axis=1).sum(axis=1)
    return np.asarray(np.concatenate([[UNREACHABLE, 0.0], angles_deg])[steps])


def travel_range(hexapod: HexapodPart, pivot_mm: NDArray[np.float64]) -> tuple[PlatformPose, PlatformPose]:
    """Lowest and highest value that each axis reaches from the zero pose while the other five stay zero.

    What the controller answers to `TMN?` and `TMX?`. To 0.01 mm and 0.01 degrees, rounded inwards.
    """
    ends = np.zeros((2, 6))
    magnitudes = np.arange(4000) / 100.0
    for axis in range(6):
        for side, sign in enumerate((-1.0, 1.0)):
            poses = np.zeros((len(magnitudes), 6))
            poses[:, axis] = sign * magnitudes
            outside = np.flatnonzero(~within_limits(hexapod, poses, pivot_mm))
            ends[side, axis] = sign * magnitudes[outside[0] - 1 if len(outside) else -1]
    return PlatformPose.from_array(ends[0]), PlatformPose.from_array(ends[1])
