"""What one image says of the C-arm that made it: the value that imaging hands to registration."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared.geometry.camera import DisplacementField, PinholeCamera
from shared.geometry.frames import Camera, Ring
from shared.geometry.transform import Transform

NOT_OF_THE_RING = -1
_Reals = NDArray[np.floating[Any]]


@dataclass(frozen=True, slots=True, eq=False)
class BallCandidates:
    """Dark discs found in an image, whoever they belong to, in measured pixels of the unmirrored image.

    Attributes
    ----------
    centre_px
        Shape (N, 2).
    radius_px
        Shape (N,).
    contrast
        Depth of the disc relative to its surroundings in grey values, shape (N,), positive.
    standard_deviation_px
        Predicted standard deviation of the centre per axis, shape (N,).
    ring_index
        Index of the ring's ball that this disc is, or `NOT_OF_THE_RING`, shape (N,).
    """

    centre_px: NDArray[np.float64]
    radius_px: NDArray[np.float64]
    contrast: NDArray[np.float64]
    standard_deviation_px: NDArray[np.float64]
    ring_index: NDArray[np.int64]

    def select(self, which: NDArray[np.bool_]) -> "BallCandidates":
        """Those that are marked."""
        return BallCandidates(
            self.centre_px[which],
            self.radius_px[which],
            self.contrast[which],
            self.standard_deviation_px[which],
            self.ring_index[which],
        )


@dataclass(frozen=True, slots=True)
class Aperture:
    """The usable part of the image: a disc (image intensifier). `None` in its place means the whole rectangle."""

    centre_px: tuple[float, float]
    radius_px: float

    def holds(self, x_px: _Reals, y_px: _Reals, margin_px: float = 0.0) -> NDArray[np.bool_]:
        """Whether places, columns and rows that broadcast, lie inside and at least a margin from the rim."""
        away_px = np.hypot(x_px - self.centre_px[0], y_px - self.centre_px[1])
        return np.asarray(away_px <= self.radius_px - margin_px)


@dataclass(frozen=True, slots=True, eq=False)
class CArmCalibration:
    """Camera, distortion and ring pose of one image.

    All pixels are those of the image after un-mirroring: when `mirrored`, column x of the image as received is column
    `width_px - 1 - x` here.

    Attributes
    ----------
    camera
        Intrinsics in ideal pixels.
    camera_from_ring
        Pose of the ring.
    distortion
        Measured to ideal pixels.
    source_covariance_mm2
        Covariance of the focal spot's position in the ring's frame, shape (3, 3).
    balls
        All discs found, with those of the ring identified.
    balls_expected
        Number of balls of the ring.
    distortion_residual_px, reprojection_rms_px
        Cross-validated residual of the distortion, and rms residual of the identified balls.
    runner_up_margin
        Identified balls of the best identity minus those of the best different one.
    focal_spot_mm
        Edge of the focal spot as stated by a person or by the image's header; None where nobody states it.
    """

    width_px: int
    height_px: int
    mirrored: bool
    camera: PinholeCamera
    camera_from_ring: Transform[Camera, Ring]
    distortion: DisplacementField
    source_covariance_mm2: NDArray[np.float64]
    balls: BallCandidates
    balls_expected: int
    distortion_residual_px: float
    reprojection_rms_px: float
    runner_up_margin: float
    aperture: Aperture | None
    focal_spot_mm: float | None = None

    @property
    def balls_found(self) -> int:
        """Number of the ring's balls that were found and identified."""
        return int(np.count_nonzero(self.balls.ring_index != NOT_OF_THE_RING))

    @property
    def pixel_mm(self) -> float:
        """Pixel pitch at the ring's plate next to the detector: its distance from the focal spot over focal length."""
        return float(self.camera_from_ring.translation_mm[2] / self.camera.focal_length_px)

    @property
    def ring_spread_mm(self) -> float:
        """Rms distance per axis of the ring's balls from where the calibration has them, at the ring's plane."""
        return self.reprojection_rms_px * self.pixel_mm

    @property
    def focal_length_deviation(self) -> float:
        """Relative standard deviation of the focal length, by that of the focal spot along the camera's axis."""
        along = self.camera_from_ring.rotation[2]
        return float(np.sqrt(along @ self.source_covariance_mm2 @ along) / self.camera_from_ring.translation_mm[2])

    def shows(self, x_px: _Reals, y_px: _Reals, margin_px: float) -> NDArray[np.bool_]:
        """Whether places, columns and rows that broadcast, are in image and aperture, a margin from their borders."""
        inside = (x_px >= margin_px) & (x_px <= self.width_px - 1 - margin_px)
        inside = inside & (y_px >= margin_px) & (y_px <= self.height_px - 1 - margin_px)
        return inside if self.aperture is None else inside & self.aperture.holds(x_px, y_px, margin_px)

    def image_from_camera(self, points_camera_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Measured pixels, shape (..., 2), where points of the camera frame, shape (..., 3), in mm, appear."""
        return self.distortion.distort(self.camera.project(points_camera_mm))

    def rays_camera(self, measured_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Unit directions, shape (..., 3), of the rays through measured pixels, shape (..., 2)."""
        return self.camera.rays(self.distortion.undistort(measured_px))

    def rays_camera_of_grid(self, x_px: NDArray[np.float64], y_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """The same for all measured pixels in columns `x_px`, shape (C,), and rows `y_px`, shape (R,): (R, C, 3)."""
        return self.camera.rays(self.distortion.undistort_grid(x_px, y_px))
