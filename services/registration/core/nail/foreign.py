"""Foreign objects over the nail: instruments, wires, screws, found as what is darker than any nail explains."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.robust import robust_spread
from services.registration.core.nail.imaging_chain import blurred_image
from services.registration.core.nail.region import FitRegion
from services.registration.core.tuning import FOREIGN_OBJECTS
from shared.geometry.parts import NailPart
from shared.xray.pixel_scale import pixels, whole_pixels


@dataclass(frozen=True, slots=True)
class RimView:
    """How much of a hole's rim takes part in the fit."""

    id: str
    share: float  # of its directions, seen from the hole's middle


def foreign_pixels(
    region: FitRegion, residual: NDArray[np.float64], variance: NDArray[np.float64], image_shape: tuple[int, int]
) -> NDArray[np.bool_]:
    """Pixels that are certainly darker than the best fit, with a margin, shape of the image.

    Metal only ever darkens. A wrong pose leaves bright residuals beside dark ones: these stay in the fit and count
    against it.

    Parameters
    ----------
    residual, variance
        Measured less modelled grey value and its noise, shape (N,); `region` has the image's own pixels.
    """
    s, pixel_mm = FOREIGN_OBJECTS, region.sampling.pixel_mm
    standardised = np.zeros(region.shape)
    standardised.ravel()[region.compared] = residual / np.sqrt(variance)
    smooth = blurred_image(standardised, pixels(s.blur_detector_mm, pixel_mm))
    limit = s.limit_in_spreads * robust_spread(smooth.ravel()[region.compared])
    dark = (smooth < -limit).astype(np.uint8)
    _, labels, sizes, _ = cv2.connectedComponentsWithStats(dark, connectivity=8)
    large = np.flatnonzero(sizes[:, cv2.CC_STAT_AREA] >= s.least_pixels)
    found = np.isin(labels, large[large > 0]).astype(np.uint8)
    side = 2 * whole_pixels(s.margin_detector_mm, pixel_mm) + 1
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    mask = np.zeros(image_shape, dtype=bool)
    left, top = (int(v) for v in region.origin_px)
    mask[top : top + region.shape[0], left : left + region.shape[1]] = cv2.dilate(found, kernel) > 0
    return mask


def rim_views(region: FitRegion, nail: NailPart) -> tuple[RimView, ...]:
    """Share of each hole's rim, by direction, where pixels are compared."""
    s = FOREIGN_OBJECTS
    views = []
    for hole in nail.holes:
        radii, direction = region.about_hole(hole, s.directions)
        near = np.abs(radii - 1.0) < s.about_rim_in_radii
        seen = np.bincount(direction[near], minlength=s.directions)
        usual = float(np.median(seen[seen > 0])) if np.any(seen) else np.inf
        views.append(RimView(hole.id, float(np.mean(seen >= s.seen_share * usual))))
    return tuple(views)
