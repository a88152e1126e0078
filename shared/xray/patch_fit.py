"""Compiled: from an image to fitted discs in one go, so that a fit of a few hundred pixels is not mostly overhead."""

import math

import numpy as np
from numpy.typing import NDArray

from shared.compiled import compiled
from shared.xray.disc_kernel import FitConstants, fit_group, uncertainties
from shared.xray.disc_model import BACKGROUND_TERMS
from shared.xray.disc_samples import gather, normalise

Array = NDArray[np.float64]
FloatImage = NDArray[np.float32]
Mask = NDArray[np.bool_]

# Guard: an inverse variance so small that it settles a parameter only where no pixel does.
WEAK = 1e-4

# Columns of what is known of discs before a fit.
X, Y, CENTRE_SD, RADIUS, RADIUS_SD = 0, 1, 2, 3, 4


@compiled
def priors_vector(known: Array, blur: tuple[float, float], bright: float, fit: FitConstants) -> tuple[Array, Array]:
    """Means and inverse variances in the kernel's order of parameters.

    Parameters
    ----------
    known
        Columns x, y, deviation of both, radius, deviation of it, in pixels; shape (K, 5).
    blur
        Blur of the edges and its deviation.
    bright
        Normalised grey value of the background.
    fit
        Tuned values.
    """
    discs, first = len(known), BACKGROUND_TERMS
    mean, precision = np.zeros(first + 4 * discs + 2), np.empty(first + 4 * discs + 2)
    mean[0] = bright
    precision[:3], precision[3:first] = WEAK, fit.curvature_precision
    for k in range(discs):
        at = first + k
        mean[at], precision[at] = fit.contrast, WEAK
        for column in (X, Y):
            at += discs
            mean[at], precision[at] = known[k, column], known[k, CENTRE_SD] ** -2
        at += discs
        mean[at], precision[at] = known[k, RADIUS], known[k, RADIUS_SD] ** -2
    mean[-2], precision[-2] = fit.overlap, fit.overlap_sd**-2
    mean[-1], precision[-1] = blur[0], blur[1] ** -2
    return mean, precision


@compiled
def fit_patch(
    pixels: FloatImage,
    usable: Mask,
    known: Array,
    blur: tuple[float, float],
    reach_px: Array,
    avoid: Array,
    passes: int,
    fit: FitConstants,
) -> tuple[Array, Array, Array, tuple[float, float, float], Array]:
    """Fit one group of discs to the pixels around them.

    Parameters
    ----------
    pixels, usable
        Image and the pixels of it that count, shape (rows, columns).
    known, blur
        As `priors_vector` takes them.
    reach_px
        Circles (x, y, radius) whose pixels are used, shape (M, 3).
    avoid
        Circles whose pixels do not count, shape (M, 3).
    passes
        Rounds of re-weighting.
    fit
        Tuned values.

    Returns
    -------
    tuple
        Parameters (none when too few pixels are usable), covariance of each centre, shape (K, 2, 2), deviation of each
        contrast, shape (K,); noise, correlation and mean squared difference of neighbouring residuals; columns x, y
        and residual of the pixels, shape (P, 3). Contrasts and residuals are in grey values.
    """
    discs = len(known)
    samples = gather(pixels, usable, reach_px[:, :2], reach_px[:, 2], avoid)
    if len(samples) < fit.least_pixels + 4 * discs:
        return np.empty(0), np.empty((0, 2, 2)), np.empty(0), (0.0, 0.0, 0.0), samples
    frame, bright, spread = normalise(samples)
    mean, precision = priors_vector(known, blur, bright, fit)
    p, normal, residual, noise, beside = fit_group(samples, frame, mean, precision, discs, passes, fit)
    centre_covariance, contrast_sd = uncertainties(normal, discs)
    for n in range(len(samples)):
        samples[n, 2] = spread * residual[n]
    for k in range(discs):
        p[BACKGROUND_TERMS + k] *= spread
        contrast_sd[k] = spread * math.sqrt(contrast_sd[k])
    return p, centre_covariance, contrast_sd, (spread * noise, beside[0], spread**2 * beside[1]), samples


# Columns of `fit_each`.
FIT_X, FIT_Y, FIT_SD, FIT_RADIUS, FIT_CONTRAST, FIT_CONTRAST_SD, FIT_NOISE = range(7)
FIT_COLUMNS = 7


@compiled
def fit_each(
    pixels: FloatImage,
    usable: Mask,
    known: Array,
    blur: tuple[float, float],
    margin_px: float,
    passes: int,
    fit: FitConstants,
) -> Array:
    """Fit discs one by one, each with the pixels up to a margin around it.

    Parameters
    ----------
    known, blur
        As `priors_vector` takes them.

    Returns
    -------
    Array
        Columns x, y, their standard deviation, radius, contrast, its deviation and noise, shape (N, 7); NaN where too
        few pixels are usable.
    """
    found = np.full((len(known), FIT_COLUMNS), np.nan)
    nothing, reach_px = np.zeros((0, 3)), np.empty((1, 3))
    for n in range(len(known)):
        reach_px[0, 0], reach_px[0, 1], reach_px[0, 2] = known[n, X], known[n, Y], known[n, RADIUS] + margin_px
        p, covariance, contrast_sd, quality, _ = fit_patch(
            pixels, usable, known[n : n + 1], blur, reach_px, nothing, passes, fit
        )
        if len(p) == 0:
            continue
        at = BACKGROUND_TERMS
        found[n, FIT_X], found[n, FIT_Y], found[n, FIT_RADIUS] = p[at + 1], p[at + 2], p[at + 3]
        found[n, FIT_SD] = math.sqrt(0.5 * (covariance[0, 0, 0] + covariance[0, 1, 1]))
        found[n, FIT_CONTRAST], found[n, FIT_CONTRAST_SD], found[n, FIT_NOISE] = p[at], contrast_sd[0], quality[0]
    return found
