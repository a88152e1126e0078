"""The usable part of an image: an intensifier's round aperture, collimator blades, or the whole rectangle."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from shared.geometry.calibration import Aperture
from shared.xray.tuning import APERTURE_SEARCH

FloatImage = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class UsableArea:
    """Where the image holds X-rays.

    Attributes
    ----------
    mask
        True inside, shape of the image.
    aperture
        The circle, when the area is one.
    """

    mask: Mask
    aperture: Aperture | None


def usable_pixels(pixels: FloatImage, aperture: Aperture | None) -> Mask:
    """Where an image holds X-rays, shape of it: in its aperture where that is known, else as the image shows."""
    return find_usable_area(pixels).mask if aperture is None else _disc_mask(pixels.shape, aperture)


def find_usable_area(pixels: FloatImage) -> UsableArea:
    """Find the part of the image that is not the black surround of an aperture or of collimator blades.

    Parameters
    ----------
    pixels
        Grey values, darker is denser, shape (rows, columns).

    Returns
    -------
    UsableArea
        The whole rectangle when there is no surround.
    """
    step = APERTURE_SEARCH.reduction
    small = np.ascontiguousarray(pixels[::step, ::step])
    inside = _not_surround(small)
    if inside.mean() > 1.0 - APERTURE_SEARCH.least_surround:
        return UsableArea(np.ones(pixels.shape, dtype=bool), None)
    circle = _circle(_rim_points(inside) * step)
    if circle is None:
        rows, columns = pixels.shape
        grown = cv2.resize(inside.astype(np.uint8), (columns, rows), interpolation=cv2.INTER_NEAREST)
        kernel = np.ones((2 * APERTURE_SEARCH.inset_px + 3,) * 2, np.uint8)
        return UsableArea(cv2.erode(grown, kernel, borderValue=1) > 0, None)
    return UsableArea(_disc_mask(pixels.shape, circle), circle)


def _not_surround(pixels: FloatImage) -> Mask:
    """Largest bright region without the darkness that is joined to the image's border, holes filled."""
    s = APERTURE_SEARCH
    low, high = np.percentile(pixels[:: s.reduction, :: s.reduction], [s.darkest_percentile, s.brightest_percentile])
    dark = (pixels <= low + s.dark_share * (high - low)).astype(np.uint8)
    regions, label = cv2.connectedComponents(dark, connectivity=4)
    kept = np.ones(regions, dtype=np.uint8)
    kept[np.concatenate([label[0], label[-1], label[:, 0], label[:, -1]])] = 0
    kept[0] = 1  # what is not dark
    inside = cv2.morphologyEx(kept[label], cv2.MORPH_OPEN, np.ones((s.opening_px, s.opening_px), np.uint8))
    count, label, stats, _ = cv2.connectedComponentsWithStats(inside)
    if count < 2:
        return np.ones(pixels.shape, dtype=bool)
    return np.asarray(label == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA])))


def _rim_points(inside: Mask) -> NDArray[np.float64]:
    """Pixels (x, y) of the area's rim that do not lie on the image's own border, shape (N, 2)."""
    contours, _ = cv2.findContours(inside.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    points = max(contours, key=len).reshape(-1, 2).astype(np.float64)
    rows, columns = inside.shape
    x, y = points.T
    return np.asarray(points[(x > 1) & (y > 1) & (x < columns - 2) & (y < rows - 2)])


def _circle(points: NDArray[np.float64]) -> Aperture | None:
    """Circle through most of the points, by least squares with the worst points left out in turns."""
    s = APERTURE_SEARCH
    if len(points) < s.least_rim_points:
        return None
    kept = points
    for _ in range(s.rounds):
        design = np.column_stack([2.0 * kept, np.ones(len(kept))])
        solution, *_ = np.linalg.lstsq(design, np.square(kept).sum(axis=1), rcond=None)
        centre = solution[:2]
        radius = float(np.sqrt(max(solution[2] + centre @ centre, 0.0)))
        residual = np.abs(np.hypot(*(points - centre).T) - radius)
        kept = points[residual < max(s.circle_residual_px, float(np.quantile(residual, s.kept_share)))]
    if np.mean(residual < s.circle_residual_px) < s.least_on_circle:
        return None
    return Aperture((float(centre[0]), float(centre[1])), radius)


def _disc_mask(shape: tuple[int, ...], circle: Aperture) -> Mask:
    """Pixels within the circle less its inset: between two columns in every row."""
    y, x = np.arange(shape[0]) - circle.centre_px[1], np.arange(shape[1]) - circle.centre_px[0]
    half2 = (circle.radius_px - APERTURE_SEARCH.inset_px) ** 2 - np.square(y)
    half = np.where(half2 >= 0.0, np.sqrt(np.maximum(half2, 0.0)), -1.0)
    return np.asarray(np.abs(x)[None, :] <= half[:, None])
