"""The ring in images: each has its own focal spot and distortion; the balls are common to all.

Only displacements along the plates are estimated: along the beam they hardly move a shadow.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve

from distalock.part_calibration.displacements import Displacements, ViewEquations, solve_displacements
from services.imaging.core.calibration import similarity_near
from services.imaging.core.joint_estimate import (
    Gauge,
    JointEstimate,
    NominalSource,
    Observations,
    estimate_jointly,
    on_plane,
)
from services.imaging.core.quality import every_ball
from services.imaging.core.tuning import DISTORTION_MODEL, NOMINAL_VALUES
from shared.geometry.calibration import CArmCalibration
from shared.geometry.parts import RingPart

Array = NDArray[np.float64]

# Balls that seem outliers with the file's places are none with the found ones.
_ROUNDS = 3


@dataclass(frozen=True, slots=True, eq=False)
class RingView:
    """The ring's balls in one image.

    Attributes
    ----------
    index
        Which of the ring's balls were measured, shape (N,).
    measured_px, deviation_px
        Where, shape (N, 2), and the standard deviation per axis, shape (N,).
    source_mm
        Focal spot in the ring's frame, shape (3,).
    middle_px
        Middle of the image, shape (2,).
    """

    index: NDArray[np.int64]
    measured_px: Array
    deviation_px: Array
    source_mm: Array
    middle_px: Array

    def estimate(self, position_mm: Array) -> JointEstimate:
        """Focal spot and distortion with the ring's balls at these places, shape (B, 3)."""
        observations = Observations(self.measured_px, self.deviation_px, position_mm[self.index])
        nominal = NominalSource(self.source_mm, np.array(NOMINAL_VALUES.source_sd_mm))
        return estimate_jointly(observations, self.source_mm, nominal, self._gauge(observations))

    def rms_px(self, position_mm: Array) -> float:
        """Rms residual per axis, each ball predicted from the others."""
        return self.estimate(position_mm).left_out_rms_px()

    def _gauge(self, observations: Observations) -> Gauge:
        plane = on_plane(observations.position_mm, self.source_mm)
        reach_px = 2.0 * DISTORTION_MODEL.gauge_reach * float(self.middle_px[0])
        return similarity_near(plane, observations.measured_px, self.middle_px, reach_px)


def ring_view(calibration: CArmCalibration, ring: RingPart, pixels: NDArray[np.float32]) -> RingView:
    """What an image, as received, shows of the ring, balls that seem outliers included."""
    centre_px, deviation_px = every_ball(calibration, ring, pixels)
    index = np.flatnonzero(np.isfinite(deviation_px))
    source = calibration.camera_from_ring.inverse().translation_mm
    middle = 0.5 * np.array([calibration.width_px - 1.0, calibration.height_px - 1.0])
    return RingView(index, centre_px[index], deviation_px[index], source, middle)


def ring_displacements(views: tuple[RingView, ...], ring: RingPart) -> Displacements:
    """Displacements of the ring's balls along x and y."""
    filed = ring.balls.position_mm
    found = np.zeros((len(filed), 2))
    for _ in range(_ROUNDS):
        equations = tuple(_equations(view, filed, found) for view in views)
        solved = solve_displacements(equations, len(filed), 2)
        found = solved.mean_mm
    return solved


def _equations(view: RingView, filed_mm: Array, displacement_mm: Array) -> ViewEquations:
    """Linearised about the present displacements, shape (B, 2), with source, polynomial and process eliminated."""
    position = filed_mm + np.pad(displacement_mm, ((0, 0), (0, 1)))
    estimate = view.estimate(position)
    solution, used = estimate.solution, view.index[estimate.used]
    height = -estimate.source_mm[2]
    scale = estimate.gauge.scale_px_per_mm * height / (height + filed_mm[used, 2])
    by_ball = scale[:, None, None] * estimate.gauge.rotation
    count, size = len(used), displacement_mm.size
    A = np.zeros((2, count, size))
    for row, ball in enumerate(used):
        A[:, row, 2 * ball : 2 * ball + 2] = by_ball[row]
    # target + A @ (further displacement) is what field and noise explain
    whitened = [cho_solve(solution.factor, A[axis]) for axis in range(2)]
    design = solution.whitened_design
    explained = sum(design[axis].T @ A[axis] for axis in range(2))
    normal = sum(A[axis].T @ whitened[axis] for axis in range(2)) - explained.T @ solution.covariance @ explained
    target = solution.system.target_px
    by_design = sum(design[axis].T @ target[:, axis] for axis in range(2))
    gradient = explained.T @ solution.covariance @ by_design - sum(
        whitened[axis].T @ target[:, axis] for axis in range(2)
    )
    return ViewEquations(np.asarray(normal), np.asarray(gradient + normal @ displacement_mm.ravel()))
