"""Least-squares fits of blurred discs.

A steel ball's shadow is a disc with soft edges on an uneven background, seen through an unknown monotone curve. Discs
whose shadows touch are fitted as one group; where two overlap the image is darker than under one of them, but not by
the sum of both, so that the depth of overlaps is a parameter of its own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.xray.disc_kernel import darkest_spot, fit_group, uncertainties
from shared.xray.disc_model import BACKGROUND_TERMS
from shared.xray.disc_samples import gather, normalise

Array = NDArray[np.float64]
FloatImage = NDArray[np.float32]
Mask = NDArray[np.bool_]

_HUBER = 2.5
_START_CONTRAST = 1.5
_START_OVERLAP = 0.8
_OVERLAP_SD = 0.3
_WEAK = 1e-4
_CURVATURE_PRECISION = 1.0
_LEAST_PIXELS = 30
NOTHING_TO_AVOID: Array = np.zeros((0, 3))


@dataclass(frozen=True, slots=True, eq=False)
class DiscPriors:
    """What is known of a group of K discs before the fit, as mean and standard deviation.

    Attributes
    ----------
    centre_px, centre_sd_px
        Shapes (K, 2) and (K,).
    radius_px, radius_sd_px
        Shape (K,) each.
    blur_px, blur_sd_px
        Gaussian blur of the edges.
    """

    centre_px: Array
    centre_sd_px: Array
    radius_px: Array
    radius_sd_px: Array
    blur_px: float
    blur_sd_px: float


@dataclass(frozen=True, slots=True, eq=False)
class DiscFit:
    """A fitted group of K discs.

    Attributes
    ----------
    centre_px, centre_covariance_px2
        Shapes (K, 2) and (K, 2, 2); the covariance takes the patch's own residuals for white noise.
    radius_px, contrast, contrast_sd
        Shape (K,); the last is how well the contrast is known of discs of this place, size and blur: whether there is
        one at all. (Size and contrast of a small noisy disc trade against one another; its being there does not.)
    blur_px, noise
        Blur of the edges, and robust residual in grey values.
    correlation, difference_variance
        Of the residuals of neighbouring pixels, the latter in squared grey values.
    residual
        What the fit leaves: columns x, y and grey value, shape (P, 3).
    """

    centre_px: Array
    centre_covariance_px2: Array
    radius_px: Array
    contrast: Array
    contrast_sd: Array
    blur_px: float
    noise: float
    correlation: float
    difference_variance: float
    residual: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Remainder:
    residual: Array
    noise: float
    correlation: float
    difference_variance: float


def fit_discs(
    pixels: FloatImage,
    usable: Mask,
    priors: DiscPriors,
    within: tuple[Array, Array],
    passes: int = 2,
    avoid: Array = NOTHING_TO_AVOID,
) -> DiscFit | None:
    """Fit a group of blurred discs on a curved background.

    Parameters
    ----------
    pixels, usable
        Image and the pixels of it that count, shape (rows, columns).
    priors
        Where the discs are thought to be, and how large.
    within
        Circles whose pixels are used: centres and radii, shapes (M, 2) and (M,).
    passes
        Rounds of re-weighting against pixels that belong to something else.
    avoid
        Circles (x, y, radius) whose pixels do not count, shape (M, 3): discs of other groups.

    Returns
    -------
    DiscFit or None
        None when too few usable pixels are near.
    """
    samples = gather(pixels, usable, *within, avoid)
    discs = len(priors.radius_px)
    if len(samples) < _LEAST_PIXELS + 4 * discs:
        return None
    frame, bright, spread = normalise(samples)
    mean, precision = _priors_vector(priors, bright)
    parameters, normal, residual, noise, neighbours = fit_group(samples, frame, mean, precision, discs, passes, _HUBER)
    samples[:, 2] = spread * residual
    return _unpacked(
        parameters, normal, discs, spread, _Remainder(samples, spread * noise, neighbours[0], spread**2 * neighbours[1])
    )


def compile_fits() -> None:
    """Compile (or load from the cache) what the fits run on, so that the first image does not wait for it."""
    y, x = np.ogrid[:24, :24]
    pixels = np.where(np.hypot(x - 12.0, y - 12.0) < 5.0, 1.0, 2.0).astype(np.float32)
    one = np.ones(1)
    priors = DiscPriors(np.array([[12.0, 12.0]]), one, 5.0 * one, one, 1.5, 0.8)
    fit = fit_discs(pixels, np.ones(pixels.shape, bool), priors, (priors.centre_px, 9.0 * one))
    assert fit is not None, "a whole disc was given"
    darkest_spot(fit.residual, fit.residual[:, 2].copy(), 3.0)


def _priors_vector(priors: DiscPriors, bright: float) -> tuple[Array, Array]:
    """Means and inverse variances in the kernel's order of parameters."""
    discs = len(priors.radius_px)
    background = np.zeros(BACKGROUND_TERMS)
    background[0] = bright
    background_precision = np.full(BACKGROUND_TERMS, _WEAK)
    background_precision[3:] = _CURVATURE_PRECISION
    mean = [background, np.full(discs, _START_CONTRAST), priors.centre_px[:, 0], priors.centre_px[:, 1]]
    mean += [priors.radius_px, np.array([_START_OVERLAP, priors.blur_px])]
    precision = [background_precision, np.full(discs, _WEAK), np.tile(priors.centre_sd_px**-2.0, 2)]
    precision += [priors.radius_sd_px**-2.0, np.array([_OVERLAP_SD**-2, priors.blur_sd_px**-2])]
    return np.concatenate(mean), np.concatenate(precision)


def _unpacked(p: Array, normal: Array, discs: int, spread: float, left: _Remainder) -> DiscFit:
    centre_covariance, contrast_variance = uncertainties(normal, discs)
    contrast_at = BACKGROUND_TERMS + np.arange(discs)
    x_at, y_at, radius_at = (contrast_at + i * discs for i in (1, 2, 3))
    return DiscFit(
        centre_px=np.stack([p[x_at], p[y_at]], axis=1),
        centre_covariance_px2=centre_covariance,
        radius_px=p[radius_at],
        contrast=p[contrast_at] * spread,
        contrast_sd=np.sqrt(contrast_variance) * spread,
        blur_px=float(p[-1]),
        noise=left.noise,
        correlation=left.correlation,
        difference_variance=left.difference_variance,
        residual=left.residual,
    )
