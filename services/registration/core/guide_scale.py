"""A guide of another size than its file says: hidden in one image, shown by images from several directions.

A guide that is larger and farther away by the same share looks the same. The nail's depth follows from the nail's own
file, so that its distance from the guide is wrong along the ray: by as much in every image, but along another ray.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.acceptance.criteria import chi_square_limit
from services.registration.core.estimation.joint import fuse
from services.registration.core.estimation.pose_estimate import PoseEstimate
from shared.geometry.frames import Camera, Guide, Nail
from shared.geometry.transform import Transform

# Chi-square is a parabola in a shift of all images; any step finds it.
_STEP_MM = 1.0
# Guard: nobody builds a guide further off than this share; images from nearly one direction would say so of any move.
_LARGEST_EXCESS = 0.1


def scale_that_agrees(
    estimates: tuple[PoseEstimate[Guide, Nail], ...], camera_from_nail: Transform[Camera, Nail]
) -> float | None:
    """Size of the guide over that of its file with which images that contradict one another agree; None for none.

    Parameters
    ----------
    camera_from_nail
        In any of the images: how far away guide and nail were.
    """
    less, none, more = (fuse(_nearer(estimates, step_mm)) for step_mm in (-_STEP_MM, 0.0, _STEP_MM))
    curvature = less.chi_square - 2.0 * none.chi_square + more.chi_square
    if curvature <= 0.0:
        return None
    nearer_mm = 0.5 * _STEP_MM * (less.chi_square - more.chi_square) / curvature
    if fuse(_nearer(estimates, nearer_mm)).chi_square > chi_square_limit(none.degrees_of_freedom - 1):
        return None
    guide_mm = float(np.linalg.norm((camera_from_nail @ none.pose.mean.inverse()).translation_mm))
    excess = nearer_mm / guide_mm
    return 1.0 + excess if abs(excess) < _LARGEST_EXCESS else None


def _nearer(estimates: tuple[PoseEstimate[Guide, Nail], ...], shift_mm: float) -> tuple[PoseEstimate[Guide, Nail], ...]:
    """The same with the nail nearer to the focal spot by so much, along the ray of each image."""
    return tuple(replace(one, mean=one.mean.moved(_along_ray(one, -shift_mm))) for one in estimates)


def _along_ray(estimate: PoseEstimate[Guide, Nail], shift_mm: float) -> NDArray[np.float64]:
    ray = np.zeros(3) if estimate.errors.ray is None else estimate.errors.ray
    return np.concatenate([np.zeros(3), shift_mm * ray])
