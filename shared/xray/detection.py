"""Find dark discs (steel balls) in an X-ray image: recall first, whoever they belong to.

Nothing is assumed of the display's curve but that darker is denser: candidates are local maxima of the correlation
coefficient with a disc, which no monotone stretch of contrast changes much, and are then fitted one by one.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np
from scipy.spatial import cKDTree

from shared.geometry.calibration import NOT_OF_THE_RING, BallCandidates
from shared.two_cores import mapped, on_both_halves
from shared.xray.disc_kernel import fit_constants
from shared.xray.discs import Array, FloatImage, Mask
from shared.xray.patch_fit import (
    FIT_CONTRAST,
    FIT_CONTRAST_SD,
    FIT_NOISE,
    FIT_RADIUS,
    FIT_SD,
    FIT_X,
    FIT_Y,
    fit_each,
)
from shared.xray.pixel_scale import USUAL_PIXEL_MM, whole_pixels
from shared.xray.pixel_scale import pixels as in_pixels
from shared.xray.tuning import DISC_DETECTION

# Fewer are fitted sooner than handed to another core.
_LEAST_SEEDS = 8
_NOTHING_KNOWN: Array = np.zeros((0, 2))


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
        First candidates that are fitted, best first.
    """

    correlation: float = field(default_factory=lambda: DISC_DETECTION.correlation)
    contrast_to_noise: float = field(default_factory=lambda: DISC_DETECTION.contrast_to_noise)
    most: int = field(default_factory=lambda: DISC_DETECTION.most_candidates)


def detect_balls(
    pixels: FloatImage,
    usable: Mask,
    radius_range_px: tuple[float, float],
    limits: DetectionLimits | None = None,
    known_px: Array = _NOTHING_KNOWN,
    pixel_mm: float = USUAL_PIXEL_MM,
) -> BallCandidates:
    """Find all dark discs of a range of radii.

    Parameters
    ----------
    pixels
        Grey values, darker is denser, shape (rows, columns).
    usable
        Pixels that hold X-rays (see `find_usable_area`), shape (rows, columns).
    radius_range_px
        Least and largest radius of the shadows.
    limits
        What counts as a ball; by default set for recall.
    known_px
        Centres of discs that need not be found, shape (N, 2).
    pixel_mm
        Pixel pitch at the detector.

    Returns
    -------
    BallCandidates
        Sorted by contrast to noise, largest first; none is identified yet.
    """
    limits = limits or DetectionLimits()
    places, radii = _first_candidates(pixels, usable, radius_range_px, limits, pixel_mm)
    if len(known_px):
        distance, _ = cKDTree(known_px).query(places.reshape(-1, 2))
        new = np.asarray(distance) > DISC_DETECTION.known_radii * radius_range_px[0]
        places, radii = places[new], radii[new]
    drift = np.full(len(radii), in_pixels(DISC_DETECTION.drift_detector_mm, pixel_mm))
    known = np.column_stack([places, drift, radii, DISC_DETECTION.radius_tolerance * radii])
    lengths_mm = DISC_DETECTION.blur_detector_mm, DISC_DETECTION.blur_sd_detector_mm, DISC_DETECTION.margin_detector_mm
    blur_px, blur_sd_px, margin_px = (in_pixels(length_mm, pixel_mm) for length_mm in lengths_mm)
    constants = fit_constants()
    halves = on_both_halves(
        lambda part: fit_each(pixels, usable, known[part], (blur_px, blur_sd_px), margin_px, 1, constants),
        len(known),
        _LEAST_SEEDS,
    )
    fits = np.concatenate(halves)
    closest_px = DISC_DETECTION.same_place_radii * radius_range_px[0]
    return _candidates(fits[_are_balls(fits, places, radius_range_px, limits, pixel_mm)], closest_px)


def _first_candidates(
    pixels: FloatImage, usable: Mask, radius_range_px: tuple[float, float], limits: DetectionLimits, pixel_mm: float
) -> tuple[Array, Array]:
    """Local maxima over place and scale: pixels (N, 2) and radii (N,)."""
    low, high = radius_range_px
    count = max(1, int(np.ceil(np.log(high / low) / np.log(DISC_DETECTION.scale_step))))
    radii = low * (high / low) ** ((np.arange(count) + 0.5) / count)
    # A coarser image shows the same discs in a fraction of the time; the fits that follow see the finest pixels.
    step = max(1, int(low / DISC_DETECTION.coarse_radius_px))
    rows, columns = (side // step * step for side in pixels.shape)
    coarse_usable = np.ascontiguousarray(usable[:rows:step, :columns:step])
    filled = _filled(
        _reduced(pixels, step), coarse_usable, whole_pixels(DISC_DETECTION.fill_detector_mm, pixel_mm) // step
    )
    correlations = mapped(lambda radius: disc_correlation(filled, float(radius) / step, 1.0 / step, pixel_mm), radii, 2)
    scores = np.stack(correlations)
    best = scores.max(axis=0)
    size = 2 * int(np.ceil(DISC_DETECTION.peak_radii * low / step)) + 1
    peak = (best >= cv2.dilate(best, np.ones((size, size), np.uint8))) & (best > limits.correlation)
    rows, columns = np.nonzero(peak)
    places = np.stack([columns, rows], axis=1) * float(step) + 0.5 * (step - 1)
    x, y = np.minimum(places.astype(np.int64), np.array(pixels.shape[::-1]) - 1).T
    rows, columns, places = rows[usable[y, x]], columns[usable[y, x]], places[usable[y, x]]
    order = np.argsort(-best[rows, columns], kind="stable")[: limits.most]
    return places[order], radii[scores[:, rows[order], columns[order]].argmax(axis=0)]


def _reduced(pixels: FloatImage, step: int) -> FloatImage:
    """Means of squares of `step` pixels; what does not fill a square at the right and lower border is left out."""
    rows, columns = (side // step for side in pixels.shape)
    if step == 1:
        return pixels
    whole = pixels[: rows * step, : columns * step]
    return np.asarray(cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA), dtype=np.float32)


def _filled(pixels: FloatImage, usable: Mask, reach_px: int) -> FloatImage:
    """Continue the image beyond its usable area, so that the area's rim casts no shadow."""
    if usable.all():
        return pixels
    weight = usable.astype(np.float32)
    size = (2 * reach_px + 1,) * 2
    inside = cv2.blur(weight, size)
    mean = cv2.blur(pixels * weight, size) / np.maximum(inside, 1e-6)
    level = np.float32(np.median(pixels[usable]))
    return np.where(usable, pixels, np.where(inside > 1e-3, mean, level)).astype(np.float32)


def disc_correlation(
    pixels: FloatImage, radius_px: float, scale: float = 1.0, pixel_mm: float = USUAL_PIXEL_MM
) -> FloatImage:
    """Correlation coefficient of each pixel's surroundings with a dark disc, shape of the image, in [-1, 1].

    Parameters
    ----------
    pixels
        Grey values, shape (rows, columns).
    radius_px
        Of the disc, in these pixels.
    scale
        Of these pixels: margin and blur are so many times what they are at full size.
    pixel_mm
        Pixel pitch at the detector, at full size.
    """
    margin = scale * in_pixels(DISC_DETECTION.margin_detector_mm, pixel_mm)
    blur = scale * in_pixels(DISC_DETECTION.blur_detector_mm, pixel_mm)
    reach = int(np.ceil(radius_px + margin))
    y, x = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    distance = np.hypot(x, y)
    window = (distance <= radius_px + margin).astype(np.float64)
    disc = 1.0 / (1.0 + np.exp((distance - radius_px) / (DISC_DETECTION.edge_steepness * blur)))
    template = window * (disc - (window * disc).sum() / window.sum())
    norm = float(np.sqrt((template**2).sum()))
    percentiles = DISC_DETECTION.darkest_percentile, 50.0, DISC_DETECTION.brightest_percentile
    low, middle, high = np.percentile(pixels[:: DISC_DETECTION.sampled_px, :: DISC_DETECTION.sampled_px], percentiles)
    image = (pixels - np.float32(middle)) / np.float32(max(high - low, 1e-6))
    mean_kernel = window / window.sum()
    variance = _filter(np.square(image), mean_kernel) - np.square(_filter(image, mean_kernel))
    deviation = np.sqrt(np.maximum(variance, DISC_DETECTION.least_deviation**2) * window.sum())
    return np.asarray(_filter(image, -template / norm) / deviation, dtype=np.float32)


def _filter(image: FloatImage, kernel: Array) -> FloatImage:
    return np.asarray(cv2.filter2D(image, cv2.CV_32F, kernel.astype(np.float32), borderType=cv2.BORDER_REPLICATE))


def _are_balls(
    fits: Array, places: Array, radius_range_px: tuple[float, float], limits: DetectionLimits, pixel_mm: float
) -> Mask:
    """Which fits (see `fit_each`) are of something that looks like a ball, shape (N,)."""
    low, high = radius_range_px
    radius, contrast = fits[:, FIT_RADIUS], fits[:, FIT_CONTRAST]
    moved = np.hypot(fits[:, FIT_X] - places[:, 0], fits[:, FIT_Y] - places[:, 1])
    return np.asarray(
        (contrast > limits.contrast_to_noise * fits[:, FIT_NOISE])
        & (contrast > DISC_DETECTION.contrast_to_sd * fits[:, FIT_CONTRAST_SD])
        & (radius > DISC_DETECTION.radius_low * low)
        & (radius < DISC_DETECTION.radius_high * high)
        & (moved < np.maximum(DISC_DETECTION.moved * radius, in_pixels(DISC_DETECTION.moved_detector_mm, pixel_mm)))
    )


def _candidates(fits: Array, closest_px: float) -> BallCandidates:
    """Sort by contrast to noise and keep the first of each place."""
    fits = fits[np.argsort(-fits[:, FIT_CONTRAST] / fits[:, FIT_NOISE], kind="stable")]
    fits = fits[_first_of_each_place(fits[:, [FIT_X, FIT_Y]], closest_px)]
    return BallCandidates(
        centre_px=fits[:, [FIT_X, FIT_Y]],
        radius_px=fits[:, FIT_RADIUS],
        contrast=fits[:, FIT_CONTRAST],
        standard_deviation_px=fits[:, FIT_SD],
        ring_index=np.full(len(fits), NOT_OF_THE_RING, dtype=np.int64),
    )


def _first_of_each_place(centre_px: Array, closest_px: float) -> Mask:
    """Mark those that no earlier one of the list is closer to than `closest_px`."""
    distance = np.hypot(*(centre_px[:, None] - centre_px[None]).transpose(2, 0, 1))
    keep = np.ones(len(centre_px), dtype=bool)
    for i in range(len(centre_px)):
        keep[i] = not bool(np.any(keep[:i] & (distance[i, :i] < closest_px)))
    return keep
