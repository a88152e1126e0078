"""How far things moved during the exposure, from the shape of the balls' shadows."""

import math

import numpy as np

from services.imaging.core.tuning import MOTION_BLUR
from shared.compiled import compiled
from shared.xray.discs import Array, FloatImage
from shared.xray.pixel_scale import USUAL_PIXEL_MM
from shared.xray.pixel_scale import pixels as in_pixels


def motion_blur_px(pixels: FloatImage, centre_px: Array, radius_px: Array, pixel_mm: float = USUAL_PIXEL_MM) -> float:
    """Length of a straight movement during the exposure that would explain how elongated the balls are.

    A movement over L pixels adds L^2/12 to the balls' second moment along it; distortion stretches balls too, but
    radially, so that it averages out over the image.

    Parameters
    ----------
    pixels
        Grey values, shape (rows, columns).
    centre_px, radius_px
        Isolated balls, shapes (N, 2) and (N,).
    pixel_mm
        Pixel pitch at the detector.

    Returns
    -------
    float
        Zero when fewer than twelve balls can be measured.
    """
    rim_px = (
        in_pixels(MOTION_BLUR.rim_from_detector_mm, pixel_mm),
        in_pixels(MOTION_BLUR.rim_to_detector_mm, pixel_mm),
    )
    moments = _moments(pixels, np.column_stack([centre_px, radius_px]), rim_px)
    moments = moments[np.isfinite(moments[:, 0])]
    if len(moments) < MOTION_BLUR.least_balls:
        return 0.0
    stretch, shear = np.median(moments, axis=0)
    return float(np.sqrt(12.0 * np.hypot(stretch, 2.0 * shear)))


@compiled
def _moments(pixels: FloatImage, balls: Array, rim_px: tuple[float, float]) -> Array:
    """Of each ball (x, y, radius) the difference of the second moments along x and y, and the mixed moment.

    In square pixels, shape (N, 2); NaN where a ball is cut by the image's border or is no shadow.
    """
    moments = np.full((len(balls), 2), np.nan)
    for k in range(len(balls)):
        x, y, radius = balls[k, 0], balls[k, 1], balls[k, 2]
        reach = math.ceil(radius + rim_px[1])
        left, top = round(x) - reach, round(y) - reach
        if left < 0 or top < 0 or left + 2 * reach >= pixels.shape[1] or top + 2 * reach >= pixels.shape[0]:
            continue
        patch = pixels[top : top + 2 * reach + 1, left : left + 2 * reach + 1]
        plane = _plane_around(patch, x - left, y - top, radius, rim_px)
        total, stretch, shear = _shadow_moments(patch, x - left, y - top, radius + rim_px[0], plane)
        if total > 0.0:
            moments[k, 0], moments[k, 1] = stretch / total, shear / total
    return moments


@compiled
def _plane_around(patch: FloatImage, x: float, y: float, radius: float, rim_px: tuple[float, float]) -> Array:
    """Background around a ball: grey value at its centre, slopes along x and y, by least squares over the rim."""
    normal, right, term = np.zeros((3, 3)), np.zeros(3), np.ones(3)
    for row in range(patch.shape[0]):
        for column in range(patch.shape[1]):
            term[1], term[2] = column - x, row - y
            from_edge = math.sqrt(term[1] ** 2 + term[2] ** 2) - radius
            if rim_px[0] < from_edge <= rim_px[1]:
                for i in range(3):
                    right[i] += term[i] * patch[row, column]
                    for j in range(3):
                        normal[i, j] += term[i] * term[j]
    return np.linalg.solve(normal, right).astype(np.float64)


@compiled
def _shadow_moments(patch: FloatImage, x: float, y: float, reach: float, plane: Array) -> tuple[float, float, float]:
    """Sum of the shadow within reach, and its sums times x^2 - y^2 and times x y."""
    total, stretch, shear = 0.0, 0.0, 0.0
    for row in range(patch.shape[0]):
        for column in range(patch.shape[1]):
            dx, dy = column - x, row - y
            if dx * dx + dy * dy <= reach * reach:
                shadow = plane[0] + plane[1] * dx + plane[2] * dy - patch[row, column]
                total += shadow
                stretch += shadow * (dx * dx - dy * dy)
                shear += shadow * dx * dy
    return total, stretch, shear
