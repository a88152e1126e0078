"""Other ways to calibrate a C-arm from the same measured balls: OpenCV's camera models, and polynomials."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from benchmarks.imaging.scenes import PX_PER_MM, SIZE_PX, monomials

Array = NDArray[np.float64]

START_MM = np.array([0.0, 0.0, -975.0])
_HALF = 0.5 * SIZE_PX


@dataclass(frozen=True, slots=True, eq=False)
class Rays:
    """Focal spot in the ring's frame, shape (3,), and directions of rays through given pixels, shape (N, 3)."""

    source_mm: Array
    directions: Array


OPENCV_MODELS = {
    "cv2, 5 coefficients": 0,
    "cv2, rational": cv2.CALIB_RATIONAL_MODEL,
    "cv2, rational + thin prism": cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL,
    "cv2, rational + thin prism + tilted": cv2.CALIB_RATIONAL_MODEL
    | cv2.CALIB_THIN_PRISM_MODEL
    | cv2.CALIB_TILTED_MODEL,
}


def opencv(flags: int, balls_mm: Array, measured_px: Array, at_px: Array) -> Rays:
    """One view of both plates, from a good start; the world's origin lies at the balls, as OpenCV needs it."""
    focal = PX_PER_MM * -START_MM[2]
    start = np.array([[focal, 0.0, _HALF], [0.0, focal, _HALF], [0.0, 0.0, 1.0]])
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 300, 1e-12)
    _, K, distortion, rotation, translation = cv2.calibrateCamera(
        [balls_mm.astype(np.float32)],
        [measured_px.astype(np.float32)],
        (SIZE_PX, SIZE_PX),
        start,
        np.zeros(5),
        flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_ASPECT_RATIO,
        criteria=criteria,
    )
    R = cv2.Rodrigues(rotation[0])[0]
    plane = cv2.undistortPointsIter(at_px[:, None], K, distortion, np.eye(3), np.eye(3), criteria).reshape(-1, 2)
    ahead = np.column_stack([plane, np.ones(len(plane))])
    return Rays(np.asarray(-R.T @ translation[0].ravel()), np.asarray(ahead @ R))


def _basis(pixels: Array, order: int) -> Array:
    return monomials((pixels - _HALF) / _HALF, order)


def _on_plane(balls_mm: Array, source_mm: Array) -> Array:
    factor = -source_mm[2] / (balls_mm[:, 2] - source_mm[2])
    return np.asarray(source_mm[:2] + (balls_mm[:, :2] - source_mm[:2]) * factor[:, None])


def _through(plane_mm: Array, source_mm: Array) -> Rays:
    return Rays(source_mm, np.column_stack([plane_mm, np.zeros(len(plane_mm))]) - source_mm)


def sequential(order: int, balls_mm: Array, measured_px: Array, at_px: Array) -> Rays:
    """Distortion from the plate at the detector alone, then the source from the other plate."""
    near = balls_mm[:, 2] == 0.0
    coefficients, *_ = np.linalg.lstsq(_basis(measured_px[near], order), balls_mm[near, :2], rcond=None)
    seen = _basis(measured_px[~near], order) @ coefficients

    def residual(source: Array) -> Array:
        return np.asarray((_on_plane(balls_mm[~near], source) - seen).ravel())

    fit = least_squares(residual, START_MM, x_scale=[1.0, 1.0, 30.0])
    return _through(_basis(at_px, order) @ coefficients, fit.x)


def joint(order: int, balls_mm: Array, measured_px: Array, at_px: Array) -> Rays:
    """Polynomial and source together over both plates, without a local correction."""
    basis = _basis(measured_px, order)
    q, _ = np.linalg.qr(basis)

    def residual(source: Array) -> Array:
        plane = _on_plane(balls_mm, source)
        return np.asarray((plane - q @ (q.T @ plane)).ravel())

    fit = least_squares(residual, START_MM, x_scale=[1.0, 1.0, 30.0], xtol=1e-12, ftol=1e-12, gtol=1e-12)
    coefficients, *_ = np.linalg.lstsq(basis, _on_plane(balls_mm, fit.x), rcond=None)
    return _through(_basis(at_px, order) @ coefficients, fit.x)
