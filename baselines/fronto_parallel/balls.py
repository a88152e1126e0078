"""Balls as the paper finds them: Hough circles give a template, correlation finds the places, a fit the centres.

The paper, "Targeting drill guide localization", steps 1 to 4. What it leaves open is chosen in its favour: one template
per size of ball, found from the circles themselves; and its reference for the fit to partial circles is taken to be an
algebraic circle fit to the points where the shadow reaches half its depth, repeated without the points that do not fit.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from shared.geometry.calibration import NOT_OF_THE_RING, BallCandidates

_CLOSING_RADII = 1.6
_CANNY_HIGH, _VOTES = 60.0, 8.0
_SHADE_QUANTILE = 99.5
_LEAST_SALIENT = 6
_TEMPLATE_MARGIN = 1.6
_LEAST_CORRELATION = 0.55
_LEAST_SHADE = 0.25
_DIRECTIONS = 48
_STEP_PX = 0.25
_LEAST_SEEN = 0.4
_FIT_ROUNDS = 4
_CENTRE_SD_PX = 0.15


def find_balls(pixels: NDArray[np.float32], usable: NDArray[np.bool_], radii_px: tuple[float, float]) -> BallCandidates:
    """Find dark discs, the most similar to a ball first.

    Parameters
    ----------
    pixels
        Un-mirrored image, darker is denser, shape (rows, columns).
    usable
        Where the image holds X-rays, same shape.
    radii_px
        Least and largest radius of a ball's shadow.

    Returns
    -------
    BallCandidates
        None of them named.
    """
    shade = _shade(pixels, usable, radii_px[1])
    templates = _templates(shade, radii_px)
    if not templates:
        return _candidates([])
    correlation = _correlation(shade, templates)
    level = _LEAST_SHADE * float(np.percentile(shade[usable], _SHADE_QUANTILE))
    places = _local_maxima(correlation, (shade > level) & usable, radii_px[0])
    return _candidates(_fitted(shade, places, radii_px))


def _shade(pixels: NDArray[np.float32], usable: NDArray[np.bool_], largest_px: float) -> NDArray[np.float32]:
    """Background, from which the balls have been removed morphologically, minus the image."""
    side = 2 * int(np.ceil(_CLOSING_RADII * largest_px)) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    filled = np.where(usable, pixels, np.float32(np.median(pixels[usable])))
    smooth = cv2.GaussianBlur(filled, (0, 0), 0.7)
    closed = cv2.morphologyEx(smooth, cv2.MORPH_CLOSE, disc)
    return np.asarray(closed - smooth, dtype=np.float32)


def _templates(shade: NDArray[np.float32], radii_px: tuple[float, float]) -> list[NDArray[np.float32]]:
    """Templates of the sizes of which there are enough salient circles."""
    white = float(np.percentile(shade, _SHADE_QUANTILE))
    eight_bits = np.clip(255.0 * shade / max(white, 1e-9), 0.0, 255.0).astype(np.uint8)
    least, most = int(np.floor(radii_px[0])), int(np.ceil(radii_px[1]))
    found = cv2.HoughCircles(
        eight_bits,
        cv2.HOUGH_GRADIENT,
        dp=1.0,
        minDist=2.0 * least,
        param1=_CANNY_HIGH,
        param2=_VOTES,
        minRadius=least,
        maxRadius=most,
    )
    if found is None:
        return []
    circles = np.asarray(found, dtype=np.float64).reshape(-1, 3)
    templates = []
    for radius in range(least, most + 1):
        own = circles[np.abs(circles[:, 2] - radius) <= 0.5]
        if len(own) >= _LEAST_SALIENT:
            templates.append(_mean_patch(shade, own[:, :2], radius))
    return templates


def _mean_patch(shade: NDArray[np.float32], centre_px: NDArray[np.float64], radius: int) -> NDArray[np.float32]:
    """Median over the circles, so that those that are no balls do not count."""
    side = 2 * int(np.ceil(_TEMPLATE_MARGIN * radius)) + 1
    patches = [cv2.getRectSubPix(shade, (side, side), (float(x), float(y))) for x, y in centre_px]
    return np.asarray(np.median(np.stack(patches), axis=0), dtype=np.float32)


def _correlation(shade: NDArray[np.float32], templates: list[NDArray[np.float32]]) -> NDArray[np.float32]:
    """Largest normalised correlation with any template, shape of the image."""
    highest = np.full(shade.shape, -1.0, dtype=np.float32)
    for template in templates:
        half = template.shape[0] // 2
        padded = cv2.copyMakeBorder(shade, half, half, half, half, cv2.BORDER_REPLICATE)
        highest = np.maximum(highest, cv2.matchTemplate(padded, template, cv2.TM_CCOEFF_NORMED))
    return np.asarray(highest, dtype=np.float32)


def _local_maxima(correlation: NDArray[np.float32], allowed: NDArray[np.bool_], apart_px: float) -> NDArray[np.int64]:
    """Rows and columns, shape (N, 2), the highest first."""
    side = 2 * int(apart_px) + 1
    highest = cv2.dilate(correlation, np.ones((side, side), np.uint8))
    places = np.argwhere((correlation >= highest) & (correlation > _LEAST_CORRELATION) & allowed)
    order = np.argsort(-correlation[tuple(places.T)], kind="stable")
    return np.asarray(places[order], dtype=np.int64)


def _fitted(
    shade: NDArray[np.float32], places: NDArray[np.int64], radii_px: tuple[float, float]
) -> list[tuple[float, float, float, float]]:
    """Circles (x, y, radius, shade) that could be fitted about the places, no two of them about the same ball."""
    kept: list[tuple[float, float, float, float]] = []
    for row, column in places:
        circle = _circle_about(shade, np.array([column, row], dtype=np.float64), radii_px)
        if circle is None:
            continue
        x, y, radius = circle
        if all(np.hypot(x - other[0], y - other[1]) > 0.7 * radius for other in kept):
            kept.append((x, y, radius, float(shade[row, column])))
    return kept


def _circle_about(
    shade: NDArray[np.float32], centre_px: NDArray[np.float64], radii_px: tuple[float, float]
) -> tuple[float, float, float] | None:
    """Circle through the points about a place where the shade is half of what it is there; None when few are found."""
    angles = np.linspace(0.0, 2.0 * np.pi, _DIRECTIONS, endpoint=False)
    distances = np.arange(0.0, 1.4 * radii_px[1], _STEP_PX)
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    where = (centre_px + rays[:, None] * distances[None, :, None]).astype(np.float32)
    profile = cv2.remap(shade, where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    half = 0.5 * float(np.percentile(profile[:, distances < 0.5 * radii_px[0]], 75))
    below = (profile < half) & (distances > 0.3 * radii_px[0])
    row = np.flatnonzero(below.any(axis=1))
    column = np.maximum(np.argmax(below[row], axis=1), 1)
    before, after = profile[row, column - 1], profile[row, column]
    share = np.clip((before - half) / np.maximum(before - after, 1e-9), 0.0, 1.0)
    points = centre_px + rays[row] * ((column - 1 + share) * _STEP_PX)[:, None]
    return _trimmed_circle(points, radii_px)


def _trimmed_circle(points_px: NDArray[np.float64], radii_px: tuple[float, float]) -> tuple[float, float, float] | None:
    used = np.ones(len(points_px), dtype=bool)
    circle = np.zeros(3)
    for _ in range(_FIT_ROUNDS):
        if np.count_nonzero(used) < _LEAST_SEEN * _DIRECTIONS:
            return None
        circle = _algebraic_circle(points_px[used])
        off = np.abs(np.hypot(*(points_px - circle[:2]).T) - circle[2])
        used = off < max(0.3, 2.5 * float(np.median(off[used])))
    if not 0.7 * radii_px[0] < circle[2] < 1.2 * radii_px[1]:
        return None
    return float(circle[0]), float(circle[1]), float(circle[2])


def _algebraic_circle(points_px: NDArray[np.float64]) -> NDArray[np.float64]:
    """Centre and radius, shape (3,): x² + y² = 2ax + 2by + c is linear in a, b, c."""
    origin = points_px.mean(axis=0)
    x, y = (points_px - origin).T
    (a, b, c), *_ = np.linalg.lstsq(np.column_stack([2.0 * x, 2.0 * y, np.ones_like(x)]), x * x + y * y, rcond=None)
    return np.array([origin[0] + a, origin[1] + b, np.sqrt(max(c + a * a + b * b, 0.0))])


def _candidates(circles: list[tuple[float, float, float, float]]) -> BallCandidates:
    table = np.array(circles, dtype=np.float64).reshape(-1, 4)
    count = len(table)
    return BallCandidates(
        table[:, :2],
        table[:, 2],
        table[:, 3],
        np.full(count, _CENTRE_SD_PX),
        np.full(count, NOT_OF_THE_RING, dtype=np.int64),
    )
