"""Measure balls where they must be, together with the neighbours whose shadows touch theirs."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from shared.two_cores import mapped
from shared.xray.discs import Array, DiscFit, DiscPriors, FloatImage, Mask, fit_discs
from shared.xray.hidden import Refit, noise_factor, usual_correlation, with_hidden
from shared.xray.pixel_scale import USUAL_PIXEL_MM
from shared.xray.pixel_scale import pixels as in_pixels
from shared.xray.tuning import BALL_MEASURING

# Fewer are done sooner than handed to another core.
_LEAST_GROUPS = 4


@dataclass(frozen=True, slots=True)
class MeasurementSettings:
    """How balls are measured.

    Attributes
    ----------
    reach_px
        How far beyond a ball's edge pixels are used.
    drift_px
        Standard deviation of the prediction, of all balls or of each, shape (N,).
    radius_tolerance
        Relative standard deviation of the predicted radius: the display's curve shrinks shadows in bright air.
    blur_px, blur_sd_px
        Blur of edges and how well it is known.
    contrast_to_sd
        Least contrast over its standard deviation for a ball to count as seen.
    pixel_mm
        Pixel pitch at the detector.
    """

    reach_px: float = field(default_factory=lambda: _usual_px(BALL_MEASURING.reach_detector_mm))
    drift_px: float | Array = field(default_factory=lambda: _usual_px(BALL_MEASURING.drift_detector_mm))
    radius_tolerance: float = field(default_factory=lambda: BALL_MEASURING.radius_tolerance)
    blur_px: float = field(default_factory=lambda: _usual_px(BALL_MEASURING.blur_detector_mm))
    blur_sd_px: float = field(default_factory=lambda: _usual_px(BALL_MEASURING.blur_sd_detector_mm))
    contrast_to_sd: float = field(default_factory=lambda: BALL_MEASURING.contrast_to_sd)
    pixel_mm: float = USUAL_PIXEL_MM


def _usual_px(length_mm: float) -> float:
    return in_pixels(length_mm, USUAL_PIXEL_MM)


@dataclass(frozen=True, slots=True, eq=False)
class Discs:
    """Places and radii of discs, shapes (N, 2) and (N,), in pixels."""

    centre_px: Array
    radius_px: Array

    @staticmethod
    def none() -> "Discs":
        """No discs."""
        return Discs(np.zeros((0, 2)), np.zeros(0))


@dataclass(frozen=True, slots=True, eq=False)
class BallMeasurements:
    """Measurements of the predicted balls, in their order.

    Attributes
    ----------
    seen
        Whether the ball was found, shape (N,); where False the other values mean nothing (NaN or an unaccepted fit).
    centre_px
        Shape (N, 2).
    standard_deviation_px
        Of the centre, per axis, shape (N,).
    radius_px, contrast
        Shape (N,).
    overlapped
        Whether another disc's shadow touches this one, shape (N,).
    noise_factor
        Ratio of real to white-noise standard deviations in this image, from the residuals' correlation.
    """

    seen: Mask
    centre_px: Array
    standard_deviation_px: Array
    radius_px: Array
    contrast: Array
    overlapped: Mask
    noise_factor: float


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """Discs that are fitted together: their indices, their priors, and their fit."""

    members: NDArray[np.int64]
    priors: DiscPriors
    refit: Refit


def measure_balls(
    pixels: FloatImage,
    predicted_px: Array,
    radius_px: Array,
    neighbours_px: Array | None = None,
    neighbour_radius_px: Array | None = None,
    settings: MeasurementSettings | None = None,
    usable: Mask | None = None,
) -> BallMeasurements:
    """Measure the centres of balls near predicted places.

    Parameters
    ----------
    pixels
        Grey values, darker is denser, shape (rows, columns).
    predicted_px, radius_px
        Where the balls must be and how large their shadows are, shapes (N, 2) and (N,).
    neighbours_px, neighbour_radius_px
        Other discs, fitted together with the balls they touch but not reported, shapes (M, 2) and (M,). Those that lie
        on a predicted ball are taken for the ball itself.
    settings
        How to measure.
    usable
        Pixels that hold X-rays (see `find_usable_area`), shape (rows, columns); all by default.

    Returns
    -------
    BallMeasurements
        One row per predicted ball; balls without contrast (over metal), cut by the rim or drifting away are not `seen`.
    """
    settings = settings or MeasurementSettings()
    usable = np.ones(pixels.shape, dtype=bool) if usable is None else usable
    predicted, neighbours = Discs(predicted_px, radius_px), Discs.none()
    if neighbours_px is not None and neighbour_radius_px is not None:
        neighbours = _not_the_balls(Discs(neighbours_px, neighbour_radius_px), predicted, settings.pixel_mm)
    count = len(radius_px)
    discs = Discs(
        np.concatenate([predicted_px, neighbours.centre_px]), np.concatenate([radius_px, neighbours.radius_px])
    )
    inside = _inside(usable, predicted)
    keep_out_px = in_pixels(BALL_MEASURING.keep_out_detector_mm, settings.pixel_mm)
    near, drift_px = _near(discs, settings.reach_px + keep_out_px), _drifts(settings, count, len(neighbours.radius_px))
    groups = []
    for members in _groups(discs, settings.pixel_mm):
        if inside[members[members < count]].any():
            priors, others = _priors(discs, drift_px, members, settings), _others(discs, members, near, keep_out_px)
            groups.append(_Group(members, priors, _fitting(pixels, usable, priors, settings.reach_px, others)))
    fits = mapped(lambda group: group.refit(group.priors), groups, _LEAST_GROUPS)
    fitted = [(group, fit) for group, fit in zip(groups, fits, strict=True) if fit is not None]
    correlation = usual_correlation([fit for _, fit in fitted])
    wholes = mapped(
        lambda of: with_hidden(of[1], of[0].priors, correlation, of[0].refit, settings.pixel_mm), fitted, _LEAST_GROUPS
    )
    rows: dict[int, tuple[DiscFit, int]] = {}
    for (group, _), whole in zip(fitted, wholes, strict=True):
        rows.update({int(disc): (whole, place) for place, disc in enumerate(group.members)})
    return _measurements(predicted, inside, rows, settings, noise_factor(correlation))


def _not_the_balls(neighbours: Discs, predicted: Discs, pixel_mm: float) -> Discs:
    """Neighbours that are not one of the predicted balls itself."""
    distance = np.hypot(*(neighbours.centre_px[:, None] - predicted.centre_px[None]).transpose(2, 0, 1))
    least_px = in_pixels(BALL_MEASURING.same_disc_detector_mm, pixel_mm)
    near = np.maximum(BALL_MEASURING.same_disc_radii * predicted.radius_px, least_px)
    own = (distance < near[None]).any(axis=1)
    return Discs(neighbours.centre_px[~own], neighbours.radius_px[~own])


def _inside(usable: Mask, discs: Discs) -> Mask:
    """Discs that lie whole in the usable area."""
    rows, columns = usable.shape
    angle = np.arange(8) * np.pi / 4.0
    rim = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = discs.centre_px[:, None] + discs.radius_px[:, None, None] * rim[None]
    x, y = np.round(points).astype(np.int64).transpose(2, 0, 1)
    there = (x >= 0) & (y >= 0) & (x < columns) & (y < rows)
    return np.asarray((there & usable[np.clip(y, 0, rows - 1), np.clip(x, 0, columns - 1)]).all(axis=1))


def _groups(discs: Discs, pixel_mm: float) -> list[NDArray[np.int64]]:
    """Indices of discs that touch; chains of many are cut at their loosest contacts."""
    distance = np.hypot(*(discs.centre_px[:, None] - discs.centre_px[None]).transpose(2, 0, 1))
    gap = distance - discs.radius_px[:, None] - discs.radius_px[None]
    reach = in_pixels(BALL_MEASURING.touch_detector_mm, pixel_mm)
    while True:
        count, label = connected_components(coo_matrix(gap < reach), directed=False)
        sizes = np.bincount(label, minlength=count)
        if sizes.max(initial=0) <= BALL_MEASURING.largest_group:
            break
        reach -= in_pixels(BALL_MEASURING.loosening_detector_mm, pixel_mm)
    order = np.argsort(label, kind="stable")
    return [m.astype(np.int64) for m in np.split(order, np.cumsum(sizes)[:-1])]


def _drifts(settings: MeasurementSettings, balls: int, neighbours: int) -> Array:
    """Standard deviations of the places of balls and then of neighbours, which are where they were found."""
    of_balls = np.broadcast_to(np.asarray(settings.drift_px, dtype=np.float64), balls)
    return np.append(of_balls, np.full(neighbours, of_balls.min(initial=np.inf)))


def _priors(discs: Discs, drift_px: Array, members: NDArray[np.int64], settings: MeasurementSettings) -> DiscPriors:
    """Priors of a group."""
    centre, radius = discs.centre_px[members], discs.radius_px[members]
    return DiscPriors(
        centre, drift_px[members], radius, settings.radius_tolerance * radius, settings.blur_px, settings.blur_sd_px
    )


def _fitting(pixels: FloatImage, usable: Mask, group: DiscPriors, reach_px: float, avoid: Array) -> Refit:
    """A fit of the pixels around a group."""
    place = group.centre_px, group.radius_px + reach_px
    return lambda priors: fit_discs(pixels, usable, priors, place, avoid=avoid)


def _near(discs: Discs, reach_px: float) -> NDArray[np.bool_]:
    """Pairs of discs of which one is within reach of the other's edge, shape (N, N)."""
    distance = np.hypot(*(discs.centre_px[:, None] - discs.centre_px[None]).transpose(2, 0, 1))
    return np.asarray(distance < discs.radius_px[:, None] + discs.radius_px[None] + reach_px)


def _others(discs: Discs, members: NDArray[np.int64], near: NDArray[np.bool_], keep_out_px: float) -> Array:
    """Circles around near discs of other groups: x, y, radius, shape (M, 3)."""
    of_others = np.asarray(near[members].any(axis=0))
    of_others[members] = False
    return np.column_stack([discs.centre_px[of_others], discs.radius_px[of_others] + keep_out_px])


def _measurements(
    predicted: Discs,
    inside: Mask,
    rows: dict[int, tuple[DiscFit, int]],
    settings: MeasurementSettings,
    factor: float,
) -> BallMeasurements:
    count = len(predicted.radius_px)
    centre, values = np.full((count, 2), np.nan), np.full((count, 4), np.nan)
    overlapped = np.zeros(count, dtype=bool)
    for ball, (fit, k) in rows.items():
        if ball < count:
            centre[ball] = fit.centre_px[k]
            deviation = factor * np.sqrt(0.5 * np.trace(fit.centre_covariance_px2[k]))
            values[ball] = deviation, fit.radius_px[k], fit.contrast[k], fit.contrast[k] / (factor * fit.contrast_sd[k])
            overlapped[ball] = len(fit.radius_px) > 1
    deviation, radius, contrast, strength = values.T
    drift = np.hypot(*(centre - predicted.centre_px).T)
    seen = (
        inside
        & np.isfinite(deviation)
        & (strength > settings.contrast_to_sd)
        & (drift < BALL_MEASURING.drift_sigmas * settings.drift_px)
    )
    return BallMeasurements(seen, centre, deviation, radius, contrast, overlapped, factor)
