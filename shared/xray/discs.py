"""Least-squares fits of blurred discs.

A steel ball's shadow is a disc with soft edges on an uneven background, seen through an unknown monotone curve. Discs
whose shadows touch are fitted as one group; where two overlap the image is darker than under one of them, but not by
the sum of both, so that the depth of overlaps is a parameter of its own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.xray.disc_kernel import fit_constants
from shared.xray.disc_model import BACKGROUND_TERMS
from shared.xray.disc_samples import darkest_spot
from shared.xray.patch_fit import fit_each, fit_patch
from shared.xray.tuning import DISC_FITTING

Array = NDArray[np.float64]
FloatImage = NDArray[np.float32]
Mask = NDArray[np.bool_]

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


def fit_discs(
    pixels: FloatImage,
    usable: Mask,
    priors: DiscPriors,
    within: tuple[Array, Array],
    passes: int | None = None,
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
        Rounds of re-weighting against pixels that belong to something else; as `DISC_FITTING` has it by default.
    avoid
        Circles (x, y, radius) whose pixels do not count, shape (M, 3): discs of other groups.

    Returns
    -------
    DiscFit or None
        None when too few usable pixels are near.
    """
    passes = DISC_FITTING.passes if passes is None else passes
    known = np.column_stack([priors.centre_px, priors.centre_sd_px, priors.radius_px, priors.radius_sd_px])
    blur = (float(priors.blur_px), float(priors.blur_sd_px))
    p, centre_covariance, contrast_sd, quality, residual = fit_patch(
        pixels, usable, known, blur, np.column_stack(within), avoid, passes, fit_constants()
    )
    if not len(p):
        return None
    discs = len(known)
    contrast, x, y, radius = p[BACKGROUND_TERMS:-2].reshape(4, discs)
    noise, correlation, difference_variance = quality
    return DiscFit(
        centre_px=np.stack([x, y], axis=1),
        centre_covariance_px2=centre_covariance,
        radius_px=radius,
        contrast=contrast,
        contrast_sd=contrast_sd,
        blur_px=float(p[-1]),
        noise=noise,
        correlation=correlation,
        difference_variance=difference_variance,
        residual=residual,
    )


def compile_fits() -> None:
    """Compile (or load from the cache) what the fits run on, so that the first image does not wait for it."""
    y, x = np.ogrid[:24, :24]
    pixels = np.where(np.hypot(x - 12.0, y - 12.0) < 5.0, 1.0, 2.0).astype(np.float32)
    one = np.ones(1)
    priors = DiscPriors(np.array([[12.0, 12.0]]), one, 5.0 * one, one, 1.5, 0.8)
    fit = fit_discs(pixels, np.ones(pixels.shape, bool), priors, (priors.centre_px, 9.0 * one))
    assert fit is not None, "a whole disc was given"
    darkest_spot(fit.residual, 3.0)
    fit_each(
        pixels,
        np.ones(pixels.shape, bool),
        np.array([[12.0, 12.0, 1.0, 5.0, 1.0]]),
        (1.5, 0.8),
        3.0,
        1,
        fit_constants(),
    )
