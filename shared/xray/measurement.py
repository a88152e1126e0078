"""Measure balls where they must be, together with the neighbours whose shadows touch theirs."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from shared.xray.discs import Array, DiscFits, DiscPriors, Patches, fit_discs
from shared.xray.patches import patches_around

FloatImage = NDArray[np.float32]
Mask = NDArray[np.bool_]

_TOUCH_PX = 2.5
_KEEP_OUT_PX = 2.5
_LARGEST_GROUP = 5


@dataclass(frozen=True, slots=True)
class MeasurementSettings:
    """How balls are measured.

    Attributes
    ----------
    reach_px
        How far beyond a ball's edge pixels are used.
    drift_px
        Standard deviation of the prediction.
    radius_tolerance
        Relative standard deviation of the predicted radius: the display's curve shrinks shadows in bright air.
    blur_px, blur_sd_px
        Blur of edges and how well it is known.
    contrast_to_sd
        Least contrast over its standard deviation for a ball to count as seen.
    noise_factor
        Ratio of a centre's real to its white-noise standard deviation: the noise of images is correlated.
    """

    reach_px: float = 4.0
    drift_px: float = 1.0
    radius_tolerance: float = 0.10
    blur_px: float = 1.3
    blur_sd_px: float = 0.3
    contrast_to_sd: float = 8.0
    noise_factor: float = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class BallMeasurements:
    """What was seen of each ball that was asked for, in the order of asking.

    Attributes
    ----------
    seen
        Whether the ball was found, shape (N,); where False the other values mean nothing.
    centre_px
        Shape (N, 2).
    standard_deviation_px
        Of the centre, per axis, shape (N,).
    radius_px, contrast
        Shape (N,).
    overlapped
        Whether another disc's shadow touches this one, shape (N,).
    """

    seen: Mask
    centre_px: Array
    standard_deviation_px: Array
    radius_px: Array
    contrast: Array
    overlapped: Mask


def measure_balls(
    pixels: FloatImage,
    predicted_px: Array,
    radius_px: Array,
    neighbours_px: Array | None = None,
    neighbour_radius_px: Array | None = None,
    settings: MeasurementSettings | None = None,
) -> BallMeasurements:
    """Measure the centres of balls near predicted places.

    Parameters
    ----------
    pixels
        Grey values, darker is denser, shape (rows, columns).
    predicted_px, radius_px
        Where the balls must be and how large their shadows are, shapes (N, 2) and (N,).
    neighbours_px, neighbour_radius_px
        Other discs, fitted together with the balls they touch but not reported, shapes (M, 2) and (M,).
    settings
        How to measure.

    Returns
    -------
    BallMeasurements
        One row per predicted ball; balls without contrast (over metal) or that drift away are not `seen`.
    """
    settings = settings or MeasurementSettings()
    others = np.zeros((0, 2)) if neighbours_px is None else neighbours_px
    other_radius = np.zeros(0) if neighbour_radius_px is None else neighbour_radius_px
    places = np.concatenate([predicted_px, others])
    radii = np.concatenate([radius_px, other_radius])
    result = _Collected(len(places))
    for members in _groups(places, radii):
        wanted = members[(members < len(predicted_px)).any(axis=1)]
        if len(wanted):
            _measure_groups(pixels, places, radii, wanted, settings, result)
    return result.measurements(len(predicted_px), predicted_px, settings)


class _Collected:
    """Results of all groups, by disc."""

    def __init__(self, count: int) -> None:
        self.centre = np.full((count, 2), np.nan)
        self.deviation = np.full(count, np.nan)
        self.radius = np.full(count, np.nan)
        self.contrast = np.zeros(count)
        self.strength = np.zeros(count)
        self.overlapped = np.zeros(count, dtype=bool)

    def add(self, members: NDArray[np.int64], fits: DiscFits) -> None:
        """Enter the fits of groups whose discs are `members`, shape (G, K)."""
        self.centre[members] = fits.centre_px
        self.deviation[members] = np.sqrt(0.5 * np.einsum("gkii->gk", fits.centre_covariance_px2))
        self.radius[members] = fits.radius_px
        self.contrast[members] = fits.contrast
        self.strength[members] = fits.contrast / fits.contrast_sd
        self.overlapped[members] = members.shape[1] > 1

    def measurements(self, count: int, predicted_px: Array, settings: MeasurementSettings) -> BallMeasurements:
        """Judge the first `count` discs."""
        drift = np.hypot(*(self.centre[:count] - predicted_px).T)
        seen = (
            np.isfinite(self.deviation[:count])
            & (self.contrast[:count] > 0.0)
            & (self.strength[:count] > settings.contrast_to_sd)
            & (drift < 4.0 * settings.drift_px)
        )
        return BallMeasurements(
            seen,
            self.centre[:count],
            settings.noise_factor * self.deviation[:count],
            self.radius[:count],
            self.contrast[:count],
            self.overlapped[:count],
        )


def _groups(places: Array, radii: Array) -> list[NDArray[np.int64]]:
    """Discs that touch, as arrays of equal group size, shape (G, K) each."""
    distance = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
    touch = distance < radii[:, None] + radii[None] + _TOUCH_PX
    reach = _TOUCH_PX
    while True:
        count, label = connected_components(coo_matrix(touch), directed=False)
        if np.bincount(label, minlength=1).max() <= _LARGEST_GROUP or reach < -20.0:
            break
        # Chains of balls side by side: cut at the loosest contacts, which then only mask each other's pixels.
        reach -= 0.5
        touch = distance < radii[:, None] + radii[None] + reach
    order = np.argsort(label, kind="stable")
    members = np.split(order, np.cumsum(np.bincount(label, minlength=count))[:-1])
    sizes = sorted({len(m) for m in members})
    return [np.stack([m for m in members if len(m) == size]).astype(np.int64) for size in sizes]


def _measure_groups(
    pixels: FloatImage,
    places: Array,
    radii: Array,
    members: NDArray[np.int64],
    settings: MeasurementSettings,
    result: _Collected,
) -> None:
    start, radius = places[members], radii[members]
    patches = patches_around(pixels, start, radius + settings.reach_px)
    patches = _without_others(patches, members, places, radii)
    priors = DiscPriors(
        radius, settings.radius_tolerance * radius, settings.blur_px, settings.blur_sd_px, settings.drift_px
    )
    result.add(members, fit_discs(patches, start, priors))


def _without_others(patches: Patches, members: NDArray[np.int64], places: Array, radii: Array) -> Patches:
    """Leave out pixels under discs that do not belong to the group."""
    weight = patches.weight.copy()
    for group, own in enumerate(members):
        reach = np.ptp(patches.x_px[group]) + 20.0
        near = np.hypot(*(places - places[own[0]]).T) < reach
        near[own] = False
        for other in np.flatnonzero(near):
            distance2 = (patches.x_px[group] - places[other, 0]) ** 2 + (patches.y_px[group] - places[other, 1]) ** 2
            weight[group] *= distance2 > (radii[other] + _KEEP_OUT_PX) ** 2
    return Patches(patches.x_px, patches.y_px, patches.grey, weight)
