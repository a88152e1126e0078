"""The curve of a display that changes from place to place, estimated from the nail's edges and undone.

Local contrast enhancement gives every place of the image a tone curve of its own: steep at the grey values that are
frequent there, flat between them. An edge's profile then looks shifted, each by another amount, and the nail turned.
Which grey value an edge's pixel would have without the curve follows from the fit: from that pixel's visible fraction,
background and floor. The differences, as a smooth function of the grey value and of the place, are the curve's inverse.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.forward_model import visible_image
from services.registration.core.nail.least_squares import LinearSolution
from services.registration.core.nail.parameters import DISPLAY_BENDS
from services.registration.core.nail.region import FitRegion
from services.registration.core.tuning import DISPLAY_CURVE

# Powers of the place along columns and rows with which the curve changes: of a quadratic.
_POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))


@dataclass(frozen=True, slots=True, eq=False)
class DisplayCurve:
    """What is added to grey values to undo the display's curve."""

    levels: NDArray[np.float64]  # increasing grey values, shape (K,)
    corrections: NDArray[np.float64]  # at each level, coefficients of a quadratic in the place, shape (6, K)
    middle_px: NDArray[np.float64]  # column and row, shape (2,)
    reach_px: float
    explained_share: float  # of the squared differences between edges as shown and as expected

    @property
    def change(self) -> float:
        """By how much corrections change with the place, over the range of the levels: rms over the levels."""
        by_level = np.sum(self.corrections[1:] ** 2, axis=0)
        return float(np.sqrt(by_level.mean()) / np.ptp(self.levels))

    def undone(self, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        """An image, shape (rows, columns), without the curve; far from the nail as at the end of the curve's place."""
        columns, rows = (np.arange(count, dtype=np.float64) for count in pixels.shape[::-1])
        x, y = _place(columns, self.middle_px[0], self.reach_px), _place(rows, self.middle_px[1], self.reach_px)
        total = pixels.astype(np.float64)
        for values, (of_x, of_y) in zip(self.corrections, _POWERS, strict=True):
            total += np.interp(pixels, self.levels, values) * x**of_x * y[:, None] ** of_y
        return total.astype(np.float32)


def display_curve_of(linear: LinearSolution, pixels: NDArray[np.float32]) -> DisplayCurve:
    """The curve under which the edges of a fit show as they do.

    Where nothing covers the background, and behind closed metal, the fit follows any curve by itself: what lies
    between them counts. A prior keeps the curve smooth, and about the same everywhere, where few pixels say more.

    Parameters
    ----------
    linear
        End of a fit, whitened or not.
    pixels
        The image that was fitted.
    """
    region, s = linear.model.region, DISPLAY_CURVE
    visible, shown = _visible_fraction(linear), region.compared_values(region.grey)
    expected = visible * linear.background + (1.0 - visible) * linear.floor
    step = float(np.median(linear.background - linear.floor))
    darkest, brightest = (float(np.quantile(shown, share)) for share in (s.cut_share, 1.0 - s.cut_share))
    levels = np.linspace(darkest, brightest, s.levels)
    places_px = _centres_px(region)
    middle_px = places_px.mean(axis=0)
    reach_px = float(np.abs(places_px - middle_px).max())
    x, y = _place(places_px, middle_px, reach_px).T
    terms = np.stack([x**of_x * y**of_y for of_x, of_y in _POWERS], axis=1)
    weight = (4.0 * visible * (1.0 - visible)).clip(0.0, 1.0) ** 2 / (s.pixel_sd * step) ** 2
    design = np.einsum("nk,nj->njk", _hats(shown, levels), terms).reshape(len(shown), -1)
    matrix = design.T @ (weight[:, None] * design) + _precision() / step**2
    missing = expected - shown
    solution = np.linalg.solve(matrix, design.T @ (weight * missing))
    explained = 1.0 - float(weight @ (missing - design @ solution) ** 2) / float(weight @ missing**2)
    brightness = _brightness(region, pixels)
    corrections = solution.reshape(len(_POWERS), s.levels) * brightness
    return DisplayCurve(levels * brightness, corrections, middle_px, reach_px, explained)


def _visible_fraction(linear: LinearSolution) -> NDArray[np.float64]:
    """Of the compared pixels, shape (N,), not whitened, without the bends that the curve replaces."""
    parameters = linear.traced.parameters.copy()
    parameters[DISPLAY_BENDS] = 0.0
    image = visible_image(linear.model, replace(linear.traced, parameters=parameters))
    return linear.model.region.compared_values(image)


def _centres_px(region: FitRegion) -> NDArray[np.float64]:
    """Columns and rows of the compared pixels in the image, shape (N, 2)."""
    rows, columns = np.divmod(region.compared, region.shape[1])
    return np.stack([columns + region.origin_px[0], rows + region.origin_px[1]], axis=1)


def _place(px: NDArray[np.float64], middle_px: float | NDArray[np.float64], reach_px: float) -> NDArray[np.float64]:
    return np.asarray(np.clip((px - middle_px) / reach_px, -1.0, 1.0))


def _hats(values: NDArray[np.float64], levels: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights with which values, shape (N,), lie at levels, shape (K,), linear between them: shape (N, K)."""
    return np.stack([np.interp(values, levels, at) for at in np.eye(len(levels))], axis=1)


def _precision() -> NDArray[np.float64]:
    """Prior's inverse covariance of the corrections in steps from metal to background, shape (6 K, 6 K)."""
    s = DISPLAY_CURVE
    bends = np.diff(np.eye(s.levels), n=2, axis=0)
    smooth = bends.T @ bends / s.bend_sd**2
    sizes = np.diag([s.correction_sd**-2, *[s.change_sd**-2] * (len(_POWERS) - 1)])
    return np.asarray(np.kron(sizes, np.eye(s.levels)) + np.kron(np.eye(len(_POWERS)), smooth))


def _brightness(region: FitRegion, pixels: NDArray[np.float32]) -> float:
    """By what the region's grey values were divided."""
    brightest = int(np.argmax(region.grey.ravel()[region.compared]))
    column, row = np.rint(_centres_px(region)[brightest]).astype(int)
    return float(pixels[row, column] / region.grey.ravel()[region.compared[brightest]])
