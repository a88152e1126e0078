"""The C-arm as a pinhole camera, and the image's distortion as a field of displacements.

Two pixel spaces appear everywhere: *measured* pixels are those of the image as received (after un-mirroring, see
`CArmCalibration.mirrored`), *ideal* pixels are those an undistorted pinhole camera would show. A `DisplacementField`
leads from measured to ideal and back; `PinholeCamera` leads from camera coordinates to ideal pixels.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, spline_filter

from shared.geometry.lines import read_only


@dataclass(frozen=True, slots=True, eq=False)
class PinholeCamera:
    """Central projection from the focal spot.

    Attributes
    ----------
    intrinsic_matrix_px
        K, shape (3, 3): focal length on the diagonal, principal point in the last column, in ideal pixels.
    """

    intrinsic_matrix_px: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.intrinsic_matrix_px.shape != (3, 3):
            raise ValueError(f"expected an intrinsic matrix of shape (3, 3), got {self.intrinsic_matrix_px.shape}")
        object.__setattr__(self, "intrinsic_matrix_px", read_only(self.intrinsic_matrix_px))

    @property
    def focal_length_px(self) -> float:
        """Mean of the two focal lengths, in pixels."""
        return float(0.5 * (self.intrinsic_matrix_px[0, 0] + self.intrinsic_matrix_px[1, 1]))

    def project(self, points_camera_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Project points of the camera frame, shape (..., 3), in mm, to ideal pixels, shape (..., 2)."""
        homogeneous = points_camera_mm @ self.intrinsic_matrix_px.T
        return np.asarray(homogeneous[..., :2] / homogeneous[..., 2:])

    def rays(self, ideal_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Directions of the rays through ideal pixels, shape (..., 2), as unit vectors, shape (..., 3)."""
        K = self.intrinsic_matrix_px
        y = (ideal_px[..., 1] - K[1, 2]) / K[1, 1]
        x = (ideal_px[..., 0] - K[0, 2] - K[0, 1] * y) / K[0, 0]
        directions = np.stack([x, y, np.ones_like(x)], axis=-1)
        return np.asarray(directions / np.linalg.norm(directions, axis=-1, keepdims=True))


@dataclass(frozen=True, slots=True, eq=False)
class DisplacementField:
    """Distortion of the image: `ideal = measured + displacement(measured)`, on a regular grid with cubic splines.

    Attributes
    ----------
    origin_px
        Measured pixel (x, y) of grid node (0, 0), shape (2,).
    spacing_px
        Distance between grid nodes, in pixels.
    displacement_px
        Displacement (x, y) at the nodes, shape (rows, columns, 2).
    standard_deviation_px
        Predicted standard deviation of the displacement per axis at the nodes, shape (rows, columns).
    """

    origin_px: NDArray[np.float64]
    spacing_px: float
    displacement_px: NDArray[np.float64]
    standard_deviation_px: NDArray[np.float64]
    _coefficients: NDArray[np.float64] = None  # type: ignore[assignment]  # derived below, once

    def __post_init__(self) -> None:
        d = self.displacement_px
        if d.ndim != 3 or d.shape[2] != 2 or min(d.shape[:2]) < 4:
            raise ValueError(f"expected displacements of shape (rows >= 4, columns >= 4, 2), got {d.shape}")
        if self.standard_deviation_px.shape != d.shape[:2]:
            raise ValueError(
                f"expected standard deviations of shape {d.shape[:2]}, got {self.standard_deviation_px.shape}"
            )
        coefficients = np.stack([spline_filter(d[..., k], order=3, mode="mirror") for k in range(2)])
        for name in ("origin_px", "displacement_px", "standard_deviation_px"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        object.__setattr__(self, "_coefficients", read_only(coefficients))

    @staticmethod
    def zero(width_px: int, height_px: int) -> "DisplacementField":
        """No distortion at all, known exactly: a flat panel."""
        spacing = max(width_px, height_px) / 4.0
        shape = (int(np.ceil(height_px / spacing)) + 1, int(np.ceil(width_px / spacing)) + 1)
        rows, columns = max(shape[0], 4), max(shape[1], 4)
        return DisplacementField(np.zeros(2), spacing, np.zeros((rows, columns, 2)), np.zeros((rows, columns)))

    def _grid_coordinates(self, points_px: NDArray[np.float64]) -> NDArray[np.float64]:
        grid = (points_px.reshape(-1, 2) - self.origin_px) / self.spacing_px
        return grid[:, ::-1].T

    def displacement_at(self, measured_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Displacement at measured pixels, shape (..., 2) in and out."""
        where = self._grid_coordinates(measured_px)
        parts = [map_coordinates(c, where, order=3, mode="nearest", prefilter=False) for c in self._coefficients]
        return np.stack(parts, axis=-1).reshape(measured_px.shape)

    def standard_deviation_at(self, measured_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Predicted standard deviation per axis at measured pixels, shape (..., 2) in, (...) out."""
        where = self._grid_coordinates(measured_px)
        return np.asarray(
            map_coordinates(self.standard_deviation_px, where, order=1, mode="nearest").reshape(measured_px.shape[:-1])
        )

    def undistort(self, measured_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Measured pixels, shape (..., 2), to ideal pixels, shape (..., 2)."""
        return measured_px + self.displacement_at(measured_px)

    def undistort_grid(self, x_px: NDArray[np.float64], y_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """As `undistort`, of all pixels in columns `x_px`, shape (C,), and rows `y_px`, shape (R,): shape (R, C, 2).

        Along rows and columns the splines separate, so that a whole window costs no more than two small products.
        """
        rows, columns = self._coefficients.shape[1:]
        by_row = self._spline_weights(y_px - self.origin_px[1], rows)
        by_column = self._spline_weights(x_px - self.origin_px[0], columns)
        ideal = np.stack(np.meshgrid(x_px, y_px), axis=-1)
        for axis, coefficients in enumerate(self._coefficients):
            ideal[..., axis] += by_row @ coefficients @ by_column.T
        return ideal

    def _spline_weights(self, from_origin_px: NDArray[np.float64], nodes: int) -> NDArray[np.float64]:
        """Weight of each node's coefficient along one axis, shape (N, nodes); beyond the nodes, the last goes on."""
        place = from_origin_px / self.spacing_px
        first = np.floor(place).astype(np.int64)
        t = place - first
        pieces = (1.0 - t) ** 3, 3.0 * t**3 - 6.0 * t**2 + 4.0, 3.0 * (t + t**2 - t**3) + 1.0, t**3
        weights, each = np.zeros((len(place), nodes)), np.arange(len(place))
        for shift, piece in enumerate(pieces):
            weights[each, np.clip(first + shift - 1, 0, nodes - 1)] += piece / 6.0
        return weights

    def distort(self, ideal_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Ideal pixels, shape (..., 2), to measured pixels, by fixed-point iteration (distortion is a few per cent)."""
        measured = ideal_px - self.displacement_at(ideal_px)
        for _ in range(12):
            step = ideal_px - self.displacement_at(measured) - measured
            measured = measured + step
            if float(np.abs(step).max(initial=0.0)) < 1e-9:
                break
        return np.asarray(measured)
