"""Which discs may be balls of the guide, a hypothesis of which are which, and its refinement on the nearest discs."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from services.registration.core.acceptance.criteria import GUIDE_BALLS, GUIDE_SHARE
from services.registration.core.estimation.image_points import Correspondences, Pose, observed, refined
from services.registration.core.tuning import GUIDE_CANDIDATES, GUIDE_IDENTIFICATION
from shared.geometry.calibration import NOT_OF_THE_RING, CArmCalibration
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Guide
from shared.geometry.parts import GuidePart
from shared.geometry.transform import Transform
from shared.xray.assignment import nearest_to_each
from shared.xray.pixel_scale import pixels

# Four points determine a pose with a residual left over.
_LEAST_POINTS = 4


@dataclass(frozen=True, slots=True, eq=False)
class GuideIdentity:
    """One hypothesis of which discs are which balls, shape (K,) each, and where the guide then is."""

    camera_from_guide: Transform[Camera, Guide]
    ball_index: NDArray[np.int64]
    disc_index: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.ball_index)


@dataclass(frozen=True, slots=True, eq=False)
class DiscMap:
    """Discs that may be balls of the guide, in ideal pixels, with a map of where they are."""

    ideal_px: NDArray[np.float64]  # shape (M, 2), those that are most likely balls first
    occupied: NDArray[np.uint8]  # 1 where a disc lies within the search tolerance of a cell, shape (rows, columns)
    # Affine map from slopes (x/z, y/z) of rays to cells (column, row), shape (2, 3)
    cell_from_slope: NDArray[np.float64]
    tree: cKDTree  # the same discs for nearest-neighbour queries
    pixel_mm: float  # pixel pitch at the detector

    @staticmethod
    def of(camera: PinholeCamera, ideal_px: NDArray[np.float64], pixel_mm: float) -> "DiscMap":
        """Build the map; at least one disc."""
        near_px = pixels(GUIDE_IDENTIFICATION.search_tolerance_detector_mm, pixel_mm)
        cell_px = pixels(GUIDE_IDENTIFICATION.map_cell_detector_mm, pixel_mm)
        origin = ideal_px.min(axis=0) - 2 * near_px
        columns, rows = (np.ceil((ideal_px.max(axis=0) + 2 * near_px - origin) / cell_px)).astype(int) + 1
        occupied = np.zeros((rows, columns), dtype=np.uint8)
        reach = int(np.ceil(near_px / cell_px))
        offsets = np.arange(-reach, reach + 1)
        dx, dy = (o.ravel() for o in np.meshgrid(offsets, offsets))
        inside = np.hypot(dx, dy) * cell_px <= near_px
        cells = np.floor((ideal_px - origin) / cell_px).astype(int)
        occupied[cells[:, 1, None] + dy[inside], cells[:, 0, None] + dx[inside]] = 1
        cell_from_slope = camera.intrinsic_matrix_px[:2].copy()
        cell_from_slope[:, 2] -= origin
        return DiscMap(ideal_px, occupied, cell_from_slope / cell_px, cKDTree(ideal_px), pixel_mm)


def refined_identity(
    camera: PinholeCamera, balls_mm: NDArray[np.float64], discs: DiscMap, start: Transform[Camera, Guide]
) -> GuideIdentity:
    """Assign discs to balls and refine the pose, with a shrinking tolerance.

    The search refines hundreds of poses: until the last step they stay bare arrays for the compiled loop.
    """
    pose = start.rotation, start.translation_mm
    for tolerance_mm in GUIDE_IDENTIFICATION.tolerances_detector_mm:
        tolerance_px = pixels(tolerance_mm, discs.pixel_mm)
        ball, disc = _assigned(camera, balls_mm, discs, pose, tolerance_px)
        if len(ball) < _LEAST_POINTS:
            return GuideIdentity(Transform.from_rotation_translation(*pose), ball, disc)
        spread = np.full(len(ball), GUIDE_IDENTIFICATION.sd_of_tolerance * tolerance_px)
        seen = observed(Correspondences(balls_mm[ball], discs.ideal_px[disc], spread))
        pose = refined(camera.intrinsic_matrix_px, pose, seen, GUIDE_IDENTIFICATION.refinement_steps)
    final = Transform[Camera, Guide].from_rotation_translation(*pose)
    return GuideIdentity(final, *_assigned(camera, balls_mm, discs, pose, tolerance_px))


def _assigned(
    camera: PinholeCamera, balls_mm: NDArray[np.float64], discs: DiscMap, pose: Pose, tolerance_px: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Nearest disc of each ball within the tolerance, no disc twice: ball and disc indices."""
    rotation, translation_mm = pose
    predicted = camera.project(balls_mm @ rotation.T + translation_mm)
    distance, disc = (np.asarray(part) for part in discs.tree.query(predicted, distance_upper_bound=tolerance_px))
    near = np.flatnonzero(np.isfinite(distance))
    ball = np.sort(near[nearest_to_each(disc[near], distance[near])])
    return ball, np.asarray(disc[ball], dtype=np.int64)


def needed_balls(count: int) -> int:
    """How many of a guide's balls must be found: twelve, and two in five; guides with few balls need all but two."""
    return min(max(int(GUIDE_BALLS.limit.value), int(np.ceil(GUIDE_SHARE.limit.value * count))), max(count - 2, 4))


def candidate_discs(calibration: CArmCalibration, guide: GuidePart) -> NDArray[np.int64]:
    """Indices of the discs that may be guide balls: not the ring's, of a possible size, the sharpest first."""
    balls = calibration.balls
    f, radius_mm = calibration.camera.focal_length_px, 0.5 * guide.balls.diameter_mm
    smallest = GUIDE_CANDIDATES.least_radius * f * float(radius_mm.min()) / GUIDE_CANDIDATES.greatest_depth_mm
    largest = GUIDE_CANDIDATES.greatest_radius * f * float(radius_mm.max()) / GUIDE_CANDIDATES.least_depth_mm
    possible = (balls.ring_index == NOT_OF_THE_RING) & (balls.radius_px > smallest) & (balls.radius_px < largest)
    index = np.flatnonzero(possible)
    clear_first = np.argsort(balls.standard_deviation_px[index], kind="stable")
    return index[clear_first[: GUIDE_CANDIDATES.most_discs]]
