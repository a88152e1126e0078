"""The guide in images: one pose each; its balls are common to all."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from distalock.part_calibration.displacements import Displacements, ViewEquations, solve_displacements
from services.registration.core.estimation.image_points import (
    Correspondences,
    down_weighted,
    projection_jacobian,
    refine_pose,
    reprojection_rms_px,
    residuals_px,
)
from services.registration.core.guide.as_built import px_per_mm
from services.registration.core.guide.locate import GuideFit
from services.registration.core.tuning import GUIDE_MEASUREMENT
from shared.geometry.calibration import CArmCalibration
from shared.geometry.camera import PinholeCamera
from shared.geometry.frames import Camera, Guide
from shared.geometry.parts import GuidePart
from shared.geometry.transform import Transform

Array = NDArray[np.float64]
Weighing = Callable[[PinholeCamera, Transform[Camera, Guide], Correspondences], Correspondences]

# The problem is almost linear. In the first rounds nothing is down-weighted: a ball that is far from its file's place
# is an outlier in every image, and would stay there.
_ROUNDS, _PLAIN_ROUNDS = 6, 2


@dataclass(frozen=True, slots=True, eq=False)
class GuideView:
    """The guide's balls in one image.

    Attributes
    ----------
    index
        Which of the guide's balls were measured, shape (N,).
    ideal_px, standard_deviation_px
        Where, undistorted, shape (N, 2), and the standard deviation per axis of measurement and distortion, shape (N,).
    """

    camera: PinholeCamera
    start: Transform[Camera, Guide]
    index: NDArray[np.int64]
    ideal_px: Array
    standard_deviation_px: Array

    def seen(self, position_mm: Array) -> Correspondences:
        """The measured balls with the guide's balls at these places, shape (B, 3)."""
        return Correspondences(position_mm[self.index], self.ideal_px, self.standard_deviation_px)

    def rms_px(self, position_mm: Array) -> float:
        """Rms distance of the measured balls from where the best pose puts balls at these places, shape (B, 3)."""
        seen = self.seen(position_mm)
        return reprojection_rms_px(self.camera, refine_pose(self.camera, self.start, seen), seen)


def guide_view(calibration: CArmCalibration, guide: GuidePart, fit: GuideFit) -> GuideView:
    """What an image shows of the guide, without the spread of its balls that the fit may have added to their errors."""
    index = np.flatnonzero(fit.used)
    scale = px_per_mm(calibration.camera, fit.camera_from_guide, guide.balls.position_mm)
    place_px = scale * np.hypot(fit.displacement_sd_mm, guide.balls.position_sd_mm)
    own = np.maximum(fit.standard_deviation_px**2 - place_px**2, GUIDE_MEASUREMENT.systematic_sd_px**2)[index]
    shared = calibration.distortion.standard_deviation_at(calibration.distortion.distort(fit.ideal_px[index]))
    return GuideView(
        calibration.camera, fit.camera_from_guide, index, fit.ideal_px[index], np.sqrt(own + np.square(shared))
    )


def guide_displacements(views: tuple[GuideView, ...], guide: GuidePart) -> Displacements:
    """Displacements of the guide's balls, along three axes, from images with the guide in different poses."""
    filed = guide.balls.position_mm
    found = np.zeros_like(filed)
    for number in range(_ROUNDS):
        weighing = _as_stated if number < _PLAIN_ROUNDS else down_weighted
        equations = tuple(_equations(view, filed, found, weighing) for view in views)
        solved = solve_displacements(equations, len(filed), 3)
        found = solved.mean_mm
    return solved


def _as_stated(_: PinholeCamera, __: Transform[Camera, Guide], seen: Correspondences) -> Correspondences:
    return seen


def _equations(view: GuideView, filed_mm: Array, displacement_mm: Array, weighing: Weighing) -> ViewEquations:
    """Linearised about the present displacements, shape (B, 3), with the image's pose eliminated."""
    seen = view.seen(filed_mm + displacement_mm)
    pose = refine_pose(view.camera, view.start, seen)
    deviation = weighing(view.camera, pose, seen).standard_deviation_px[:, None]
    by_pose = projection_jacobian(view.camera, pose, seen.body_mm) / deviation[..., None]
    residual = residuals_px(view.camera, pose, seen) / deviation
    count, size = len(seen), displacement_mm.size
    by_balls = np.zeros((count, 2, size))
    for row, ball in enumerate(view.index):
        # a ball displaced moves in the image as it does when the whole guide is moved
        by_balls[row, :, 3 * ball : 3 * ball + 3] = by_pose[row, :, 3:]
    A, J, r = by_balls.reshape(2 * count, size), by_pose.reshape(2 * count, 6), residual.ravel()
    basis = np.linalg.qr(J)[0]
    free = A - basis @ (basis.T @ A)
    normal = free.T @ free
    return ViewEquations(normal, free.T @ r + normal @ displacement_mm.ravel())
