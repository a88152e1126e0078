"""A way to name discs as balls of the guide, and how it settles on the discs nearest to where it puts the balls."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from services.registration.core.pose import Correspondences, RigidPose, refine_pose
from shared.geometry.camera import PinholeCamera
from shared.xray.assignment import nearest_to_each

_LOOSE_PX = 6.0
_TIGHT_PX = 1.5
_CELL_PX = 2.0
_SETTLING_STEPS = 5


@dataclass(frozen=True, slots=True, eq=False)
class GuideIdentity:
    """One way to name the discs.

    Attributes
    ----------
    pose
        Guide in the camera's frame.
    ball_index, disc_index
        Which ball is which disc, shape (K,) each.
    """

    pose: RigidPose
    ball_index: NDArray[np.int64]
    disc_index: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.ball_index)


@dataclass(frozen=True, slots=True, eq=False)
class Discs:
    """Discs that may be balls of the guide, in ideal pixels, with a map for quick look-up.

    Attributes
    ----------
    ideal_px
        Shape (M, 2), those that are most likely balls first.
    occupied
        1 where a disc lies within the loose tolerance of a cell, shape (rows, columns).
    cell_from_slope
        Affine map from slopes (x/z, y/z) of rays to cells (column, row), shape (2, 3).
    tree
        The same discs for nearest-neighbour queries.
    """

    ideal_px: NDArray[np.float64]
    occupied: NDArray[np.uint8]
    cell_from_slope: NDArray[np.float64]
    tree: cKDTree

    @staticmethod
    def of(camera: PinholeCamera, ideal_px: NDArray[np.float64]) -> "Discs":
        """Build the look-up map; at least one disc."""
        origin = ideal_px.min(axis=0) - 2 * _LOOSE_PX
        columns, rows = (np.ceil((ideal_px.max(axis=0) + 2 * _LOOSE_PX - origin) / _CELL_PX)).astype(int) + 1
        occupied = np.zeros((rows, columns), dtype=np.uint8)
        reach = int(np.ceil(_LOOSE_PX / _CELL_PX))
        offsets = np.arange(-reach, reach + 1)
        dx, dy = (o.ravel() for o in np.meshgrid(offsets, offsets))
        inside = np.hypot(dx, dy) * _CELL_PX <= _LOOSE_PX
        cells = np.floor((ideal_px - origin) / _CELL_PX).astype(int)
        occupied[cells[:, 1, None] + dy[inside], cells[:, 0, None] + dx[inside]] = 1
        cell_from_slope = camera.intrinsic_matrix_px[:2].copy()
        cell_from_slope[:, 2] -= origin
        return Discs(ideal_px, occupied, cell_from_slope / _CELL_PX, cKDTree(ideal_px))


def settled(camera: PinholeCamera, balls_mm: NDArray[np.float64], discs: Discs, pose: RigidPose) -> GuideIdentity:
    """Assign discs to balls and refine, with a shrinking tolerance."""
    for tolerance_px in (10.0, 6.0, 4.0, 2.5, _TIGHT_PX):
        ball, disc = _assigned(camera, balls_mm, discs, pose, tolerance_px)
        if len(ball) < 4:
            return GuideIdentity(pose, ball, disc)
        spread = np.full(len(ball), 0.3 * tolerance_px)
        pose = refine_pose(camera, pose, Correspondences(balls_mm[ball], discs.ideal_px[disc], spread), _SETTLING_STEPS)
    return GuideIdentity(pose, *_assigned(camera, balls_mm, discs, pose, _TIGHT_PX))


def _assigned(
    camera: PinholeCamera, balls_mm: NDArray[np.float64], discs: Discs, pose: RigidPose, tolerance_px: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Nearest disc of each ball within the tolerance, no disc twice: ball and disc indices."""
    nearest = discs.tree.query(camera.project(pose.points(balls_mm)), distance_upper_bound=tolerance_px)
    distance, disc = (np.asarray(part) for part in nearest)
    near = np.flatnonzero(np.isfinite(distance))
    ball = np.sort(near[nearest_to_each(disc[near], distance[near])])
    return ball, np.asarray(disc[ball], dtype=np.int64)
