"""Find dark discs (steel balls) in an X-ray image: recall first, whoever they belong to.

Nothing is assumed of the display's curve but that darker is denser: candidates are local maxima of the correlation
coefficient with a disc, which no monotone stretch of contrast changes much, and are then fitted one by one.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from shared.geometry.calibration import NOT_OF_THE_RING, BallCandidates
from shared.xray.discs import Array, DiscFits, DiscPriors, fit_discs
from shared.xray.patches import patches_around

FloatImage = NDArray[np.float32]

_SCALE_STEP = 1.22
_BLUR_PX = 1.3
_MARGIN_PX = 3.0


@dataclass(frozen=True, slots=True)
class DetectionLimits:
    """What counts as a ball.

    Attributes
    ----------
    correlation
        Least correlation coefficient with a disc, for a first candidate.
    contrast_to_noise
        Least fitted contrast over the residual noise of the fit.
    most
        Candidates kept, best first.
    """

    correlation: float = 0.5
    contrast_to_noise: float = 4.0
    most: int = 600


def ball_radius_range_px(
    diameters_mm: Array, pixel_mm: float, magnification_range: tuple[float, float], tolerance: float
) -> tuple[float, float]:
    """Least and largest radius of balls' shadows.

    Parameters
    ----------
    diameters_mm
        Of all balls that may appear.
    pixel_mm
        Nominal size of a pixel at the detector.
    magnification_range
        Of the planes in which the balls may lie.
    tolerance
        Relative error of the nominal values.
    """
    radius = 0.5 * np.array([diameters_mm.min(), diameters_mm.max()]) / pixel_mm
    low, high = radius * np.array(magnification_range) * np.array([1.0 - tolerance, 1.0 + tolerance])
    return float(low), float(high)


def detect_balls(
    pixels: FloatImage, radius_range_px: tuple[float, float], limits: DetectionLimits | None = None
) -> BallCandidates:
    """Find all dark discs of a range of radii.

    Parameters
    ----------
    pixels
        Grey values, darker is denser, shape (rows, columns).
    radius_range_px
        Least and largest radius of the shadows.
    limits
        What counts as a ball; by default tuned for recall.

    Returns
    -------
    BallCandidates
        Sorted by contrast to noise, largest first; none is identified yet.
    """
    limits = limits or DetectionLimits()
    seeds, radii = _seeds(pixels, radius_range_px, limits)
    if len(seeds) == 0:
        return _candidates(np.zeros((0, 2)), np.zeros(0), np.zeros(0), np.zeros(0))
    fits = _fit_each(pixels, seeds, radii)
    return _accepted(fits, seeds, radius_range_px, limits)


def _seeds(
    pixels: FloatImage, radius_range_px: tuple[float, float], limits: DetectionLimits
) -> tuple[Array, Array]:
    """Local maxima over place and scale: pixels (N, 2) and radii (N,)."""
    low, high = radius_range_px
    count = max(1, int(np.ceil(np.log(high / low) / np.log(_SCALE_STEP))))
    radii = low * (high / low) ** ((np.arange(count) + 0.5) / count)
    best = np.full(pixels.shape, -1.0, dtype=np.float32)
    which = np.zeros(pixels.shape, dtype=np.int64)
    for index, radius in enumerate(radii):
        score = disc_correlation(pixels, float(radius))
        better = score > best
        best[better] = score[better]
        which[better] = index
    size = 2 * int(np.ceil(0.7 * low)) + 1
    peak = (best >= cv2.dilate(best, np.ones((size, size), np.uint8))) & (best > limits.correlation)
    rows, columns = np.nonzero(peak)
    order = np.argsort(-best[rows, columns], kind="stable")[: limits.most]
    rows, columns = rows[order], columns[order]
    return np.stack([columns, rows], axis=1).astype(np.float64), radii[which[rows, columns]]


def disc_correlation(pixels: FloatImage, radius_px: float) -> FloatImage:
    """Correlation coefficient of each pixel's surroundings with a dark disc, shape of the image, in [-1, 1]."""
    reach = int(np.ceil(radius_px + _MARGIN_PX))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    distance = np.hypot(x, y)
    window = (distance <= radius_px + _MARGIN_PX).astype(np.float64)
    disc = 1.0 / (1.0 + np.exp((distance - radius_px) / (0.6 * _BLUR_PX)))
    template = window * (disc - (window * disc).sum() / window.sum())
    norm = float(np.sqrt((template**2).sum()))
    image = pixels.astype(np.float64) - float(np.median(pixels))
    response = _filter(image, -template / norm)
    mean = _filter(image, window / window.sum())
    energy = _filter(image**2, window / window.sum()) - mean**2
    floor = _energy_floor(pixels)
    deviation = np.sqrt(np.maximum(energy, floor) * window.sum())
    return np.asarray(response / deviation, dtype=np.float32)


def _filter(image: Array, kernel: Array) -> Array:
    return np.asarray(cv2.filter2D(image, cv2.CV_64F, kernel, borderType=cv2.BORDER_REPLICATE))


def _energy_floor(pixels: FloatImage) -> float:
    """A variance below which a window holds nothing but rounding: a thousandth of the image's span, squared."""
    low, high = np.percentile(pixels[::8, ::8], [1.0, 99.0])
    return float(max(high - low, 1e-6) * 1e-3) ** 2


def _fit_each(pixels: FloatImage, seeds: Array, radii: Array) -> DiscFits:
    reach = radii[:, None] + _MARGIN_PX + 1.0
    priors = DiscPriors(radii[:, None], 0.25 * radii[:, None], _BLUR_PX, 0.4, 2.0)
    return fit_discs(patches_around(pixels, seeds[:, None, :], reach), seeds[:, None, :], priors)


def _accepted(
    fits: DiscFits, seeds: Array, radius_range_px: tuple[float, float], limits: DetectionLimits
) -> BallCandidates:
    centre, radius, contrast = fits.centre_px[:, 0], fits.radius_px[:, 0], fits.contrast[:, 0]
    strength = contrast / fits.residual
    low, high = radius_range_px
    good = (
        (strength > limits.contrast_to_noise)
        & (contrast > 6.0 * fits.contrast_sd[:, 0])
        & (radius > 0.6 * low)
        & (radius < 1.3 * high)
        & (np.hypot(*(centre - seeds).T) < 0.75 * radius)
    )
    order = np.flatnonzero(good)[np.argsort(-strength[good], kind="stable")]
    order = order[_first_of_each_place(centre[order], 0.5 * low)]
    variance = 0.5 * np.einsum("gkk->g", fits.centre_covariance_px2[order, 0][:, :, :])
    return _candidates(centre[order], radius[order], contrast[order], np.sqrt(variance))


def _first_of_each_place(centre_px: Array, closest_px: float) -> NDArray[np.bool_]:
    """Mark those that no earlier one of the list is closer to than `closest_px`."""
    distance = np.hypot(*(centre_px[:, None] - centre_px[None]).transpose(2, 0, 1))
    keep = np.ones(len(centre_px), dtype=bool)
    for i in range(len(centre_px)):
        keep[i] = not bool(np.any(keep[:i] & (distance[i, :i] < closest_px)))
    return keep


def _candidates(centre: Array, radius: Array, contrast: Array, deviation: Array) -> BallCandidates:
    return BallCandidates(centre, radius, contrast, deviation, np.full(len(centre), NOT_OF_THE_RING, dtype=np.int64))
