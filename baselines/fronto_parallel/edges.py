"""The dewarped image and its edges: Canny, then each edge moved to where the gradient is largest (sub-pixel)."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from services.registration.core.subpixel import subpixel_offset
from shared.geometry.calibration import CArmCalibration

_GRID_PX = 8
_SMOOTHING_PX = 1.2
_HIGH_OVER_TYPICAL, _LOW_TO_HIGH = 7.0, 0.4
_RIM_PX = 9
_OVER_BALL = 1.35


@dataclass(frozen=True, slots=True, eq=False)
class EdgeImage:
    """A dewarped image with its edges.

    Attributes
    ----------
    grey
        Smoothed grey values in ideal pixels, shape (rows, columns).
    usable
        Where the image holds X-rays and no ball lies, same shape.
    place_px
        Edge elements to a fraction of a pixel, shape (N, 2).
    outward
        Unit direction of each element's gradient, towards the brighter side, shape (N, 2).
    strength
        Size of each element's gradient, shape (N,).
    """

    grey: NDArray[np.float32]
    usable: NDArray[np.bool_]
    place_px: NDArray[np.float64]
    outward: NDArray[np.float64]
    strength: NDArray[np.float64]

    def grey_at(self, points_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Grey values at points, shape (N, 2), linearly interpolated, shape (N,)."""
        return _sampled(self.grey, points_px)


def edge_image(upright: NDArray[np.float32], calibration: CArmCalibration, balls_px: NDArray[np.float64]) -> EdgeImage:
    """Dewarp an un-mirrored image, shape (rows, columns), and find its edges away from the known balls.

    Parameters
    ----------
    balls_px
        Measured pixels and radii of the balls' shadows, shape (K, 3).
    """
    x, y = _source_pixels(upright.shape, calibration)
    dewarped = cv2.remap(upright, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    inside = cv2.remap(_lit(upright.shape, calibration), x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT)
    usable = cv2.erode(inside, np.ones((2 * _RIM_PX + 1,) * 2, np.uint8), borderValue=0) > 0
    usable &= ~_over_balls(upright.shape, calibration, balls_px)
    grey = np.asarray(cv2.GaussianBlur(dewarped, (0, 0), _SMOOTHING_PX), dtype=np.float32)
    return EdgeImage(grey, usable, *_edges(grey, usable))


def _source_pixels(shape: tuple[int, ...], calibration: CArmCalibration) -> tuple[NDArray[np.float32], ...]:
    """Measured x and y of every ideal pixel: worked out on a coarse grid, as the distortion is smooth."""
    rows, columns = shape[0], shape[1]
    y, x = np.arange(0, rows + _GRID_PX, _GRID_PX), np.arange(0, columns + _GRID_PX, _GRID_PX)
    nodes = np.stack(np.meshgrid(x, y), axis=-1).astype(np.float64)
    measured = calibration.distortion.distort(nodes)
    fine_y, fine_x = np.mgrid[0:rows, 0:columns].astype(np.float32) / np.float32(_GRID_PX)
    return tuple(
        np.asarray(cv2.remap(measured[..., k].astype(np.float32), fine_x, fine_y, cv2.INTER_CUBIC)) for k in range(2)
    )


def _lit(shape: tuple[int, ...], calibration: CArmCalibration) -> NDArray[np.uint8]:
    """1 inside the calibration's aperture: an unlit surround and a nail that reaches the border are both dark."""
    if calibration.aperture is None:
        return np.ones(shape, dtype=np.uint8)
    lit = np.zeros(shape, dtype=np.uint8)
    (x, y), radius = calibration.aperture.centre_px, calibration.aperture.radius_px
    cv2.circle(lit, (round(x), round(y)), int(radius), 1, -1)
    return lit


def _over_balls(
    shape: tuple[int, ...], calibration: CArmCalibration, balls_px: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Where a ball lies: its rim is no edge of the nail's."""
    covered = np.zeros(shape, dtype=np.uint8)
    for (x, y), radius in zip(calibration.distortion.undistort(balls_px[:, :2]), balls_px[:, 2], strict=True):
        cv2.circle(covered, (round(x), round(y)), round(_OVER_BALL * radius + 1.0), 1, -1)
    return covered > 0


def _edges(
    grey: NDArray[np.float32], usable: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Canny; places, directions and strengths."""
    dx, dy = (cv2.Sobel(grey, cv2.CV_32F, 1 - k, k) for k in range(2))
    size = np.hypot(dx, dy)
    scale = 20000.0 / max(float(size.max()), 1e-9)
    high = scale * _HIGH_OVER_TYPICAL * float(np.median(size[usable]))
    short = [np.asarray(np.rint(scale * part), dtype=np.int16) for part in (dx, dy)]
    found = (cv2.Canny(short[0], short[1], _LOW_TO_HIGH * high, high, L2gradient=True) > 0) & usable
    rows, columns = np.nonzero(found)
    outward = np.stack([dx[found], dy[found]], axis=-1) / np.maximum(size[found], 1e-9)[:, None]
    place = np.stack([columns, rows], axis=-1).astype(np.float64)
    before, here, after = (_sampled(size, place + k * outward) for k in (-1.0, 0.0, 1.0))
    place = place + subpixel_offset(before, here, after)[:, None] * outward
    return place, outward.astype(np.float64), size[found].astype(np.float64)


def _sampled(image: NDArray[np.float32], points_px: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(map_coordinates(image, points_px.T[::-1], order=1, mode="nearest"), dtype=np.float64)
