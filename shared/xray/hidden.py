"""Balls that were not predicted: the residuals of a fit show them, and they join its group."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from shared.xray.disc_samples import darkest_spot
from shared.xray.discs import DiscFit, DiscPriors
from shared.xray.pixel_scale import pixels
from shared.xray.tuning import HIDDEN_BALLS

Refit = Callable[[DiscPriors], DiscFit | None]


def with_hidden(fit: DiscFit, priors: DiscPriors, correlation: float, refit: Refit, pixel_mm: float) -> DiscFit:
    """Add discs to a fitted group that were not known of.

    Detection misses many a ball that another one covers in part; where the fit without it leaves a dark spot of a
    ball's size, a disc is added, and kept when it explains what was left.

    Parameters
    ----------
    fit, priors
        The group as it was fitted.
    correlation
        Of neighbouring pixels' noise in this image. (What a wrong model leaves is correlated itself.)
    refit
        Fits the same pixels under other priors.
    pixel_mm
        Pixel pitch at the detector.

    Returns
    -------
    DiscFit
        The discs that were asked for come first.
    """
    for _ in range(HIDDEN_BALLS.most):
        if not _disturbed(fit, priors):
            return fit
        # Held where they must be, the known discs leave what they would otherwise lean towards.
        held = refit(_stiff(priors))
        more = None if held is None else _with_spot(held, priors, correlation, pixel_mm)
        better = None if more is None else refit(more)
        if more is None or better is None or not _explains(better, fit, correlation):
            return fit
        fit, priors = better, more
    return fit


def _disturbed(fit: DiscFit, priors: DiscPriors) -> bool:
    """Whether a disc is not where or not what it should be."""
    moved = np.hypot(*(fit.centre_px - priors.centre_px).T) > HIDDEN_BALLS.moved_sigmas * priors.centre_sd_px
    grown = fit.radius_px > (1.0 + HIDDEN_BALLS.grown) * priors.radius_px
    return bool((moved | grown).any())


def _stiff(priors: DiscPriors) -> DiscPriors:
    return replace(
        priors,
        centre_sd_px=HIDDEN_BALLS.centre_stiffness * priors.centre_sd_px,
        radius_sd_px=HIDDEN_BALLS.stiff_radius * priors.radius_px,
    )


def _with_spot(fit: DiscFit, priors: DiscPriors, correlation: float, pixel_mm: float) -> DiscPriors | None:
    """Priors of the group with a disc at the darkest spot that is left, or None when there is none."""
    radius = float(np.mean(priors.radius_px))
    where, sum_over_root = darkest_spot(fit.residual, 0.5 * radius)
    if sum_over_root < HIDDEN_BALLS.dark_spot_sigmas * noise_factor(correlation) * _local_noise(fit, correlation):
        return None
    place = fit.residual[where, :2]
    return DiscPriors(
        np.concatenate([priors.centre_px, place[None]]),
        np.append(priors.centre_sd_px, pixels(HIDDEN_BALLS.drift_detector_mm, pixel_mm)),
        np.append(priors.radius_px, radius),
        np.append(priors.radius_sd_px, HIDDEN_BALLS.radius_tolerance * radius),
        priors.blur_px,
        priors.blur_sd_px,
    )


def _explains(better: DiscFit, fit: DiscFit, correlation: float) -> bool:
    """Whether the last disc of a fit is one: beside the others, clearly there, and the rest fits better."""
    apart = np.hypot(*(better.centre_px[:-1] - better.centre_px[-1]).T)
    strength = better.contrast[-1] / (noise_factor(correlation) * better.contrast_sd[-1])
    squares = [np.sum(np.square(f.residual[:, 2])) for f in (fit, better)]
    gain = (squares[0] - squares[1]) / (noise_factor(correlation) * _local_noise(better, correlation)) ** 2
    return bool(
        (apart > HIDDEN_BALLS.least_apart * better.radius_px[-1]).all()
        and strength > HIDDEN_BALLS.least_strength
        and better.contrast[-1] > HIDDEN_BALLS.least_contrast * better.contrast[:-1].max()
        and gain > HIDDEN_BALLS.least_gain
    )


def _local_noise(fit: DiscFit, correlation: float) -> float:
    """Noise of a patch from the differences of neighbours, which a wrong model hardly changes."""
    return float(np.sqrt(0.5 * fit.difference_variance / (1.0 - min(correlation, HIDDEN_BALLS.most_correlated))))


def usual_correlation(fits: Sequence[DiscFit]) -> float:
    """Correlation of neighbouring pixels' noise in an image, not negative.

    Wrong models, where something is covered, only raise it: the patches in the lower half are to be believed.
    """
    return max(float(np.quantile([f.correlation for f in fits], HIDDEN_BALLS.typical_quantile)), 0.0) if fits else 0.0


def noise_factor(correlation: float) -> float:
    """Ratio of real to white-noise standard deviations when neighbours' noise is correlated like blurred white noise.

    White noise blurred by a Gaussian correlates over a distance d as r^(d^2), with r that of neighbours; the sum over
    all distances is what a mean over many pixels has more variance than white noise would give it.
    """
    r = min(correlation, HIDDEN_BALLS.most_correlated)
    return 1.0 + 2.0 * (r + r**4 + r**9 + r**16)
