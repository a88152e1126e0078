"""Find the nail as a dark band of known width: an edge detector, then a Hough transform for pairs of parallel edges.

The search runs on a reduced copy of the image in *ideal* pixels, where the band is straight. Nothing is measured there:
its candidates are measured in the image as received (`search/outline.py`).
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from services.registration.core.tuning import NAIL_BAND_SEARCH
from shared.geometry.calibration import CArmCalibration
from shared.geometry.parts import NailPart

# Cosine and sine of all whole degrees, shape (2, 360).
_DIRECTIONS = np.stack([np.cos(np.radians(np.arange(360))), np.sin(np.radians(np.arange(360)))])


@dataclass(frozen=True, slots=True, eq=False)
class SearchImage:
    """Reduced image in ideal pixels."""

    grey: NDArray[np.float32]  # grey values scaled to about 0..1, shape (rows, columns), float32
    valid: NDArray[np.bool_]  # false outside the aperture and the received image, shape (rows, columns)
    step_px: float  # ideal pixels per pixel of this image

    def ideal_px(self, search_px: NDArray[np.float64]) -> NDArray[np.float64]:
        """Pixels of this image, shape (..., 2), to ideal pixels, shape (..., 2)."""
        return search_px * self.step_px


@dataclass(frozen=True, slots=True, eq=False)
class Band:
    """A straight dark band in a search image."""

    # A point on the middle line and the unit direction along it, shape (2,) each, in pixels of the search image
    centre_px: NDArray[np.float64]
    along: NDArray[np.float64]
    width_px: float  # distance between the two edges, in pixels of the search image
    edge_length_px: float  # length of the shorter of its two edges, weighted by contrast

    @property
    def across(self) -> NDArray[np.float64]:
        """Unit direction across the band, a quarter turn from `along` (x to y), shape (2,)."""
        return np.array([-self.along[1], self.along[0]])


def depth_range_mm(calibration: CArmCalibration) -> tuple[float, float]:
    """Depths from the focal spot, in mm, between which a nail can lie, from the ring's place on the detector."""
    ring_depth_mm = float(calibration.camera_from_ring.translation_mm[2])
    s = NAIL_BAND_SEARCH
    nearest_mm = max(ring_depth_mm - s.farthest_from_detector_mm, s.nearest_to_source_mm)
    return nearest_mm, ring_depth_mm - s.nearest_to_detector_mm


def prepare_search(pixels: NDArray[np.generic], calibration: CArmCalibration, nail: NailPart) -> SearchImage:
    """Undistort and reduce an image so that the nail is about 30 pixels wide.

    Parameters
    ----------
    pixels
        Un-mirrored image, shape (height, width), any real type.
    """
    near_mm, far_mm = depth_range_mm(calibration)
    nominal_width_px = nail.diameter_mm * calibration.camera.focal_length_px / (0.5 * (near_mm + far_mm))
    step = max(1.0, round(nominal_width_px / NAIL_BAND_SEARCH.band_width_px))
    columns, rows = int(calibration.width_px / step), int(calibration.height_px / step)
    where = _measured_px_of_grid(calibration, rows, columns, step)
    image = cv2.GaussianBlur(pixels.astype(np.float32), (0, 0), NAIL_BAND_SEARCH.reduction_blur * step)
    grey = cv2.remap(image, where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    valid = calibration.shows(where[..., 0], where[..., 1], NAIL_BAND_SEARCH.border_px * step)
    percentiles = NAIL_BAND_SEARCH.lowest_grey_percentile, NAIL_BAND_SEARCH.highest_grey_percentile
    low, high = np.percentile(grey[valid], percentiles) if valid.any() else (0.0, 1.0)
    return SearchImage(((grey - low) / max(float(high - low), 1e-9)).astype(np.float32), valid, step)


def _measured_px_of_grid(calibration: CArmCalibration, rows: int, columns: int, step_px: float) -> NDArray[np.float32]:
    spacing = NAIL_BAND_SEARCH.map_step_px
    nodes_x, nodes_y = (np.arange(0, count + spacing, spacing) for count in (columns, rows))
    ideal = np.stack(np.meshgrid(nodes_x, nodes_y), axis=-1).astype(np.float64) * step_px
    nodes = calibration.distortion.distort(ideal).astype(np.float32)
    x, y = np.meshgrid(np.arange(columns, dtype=np.float32), np.arange(rows, dtype=np.float32))
    return np.asarray(cv2.remap(nodes, x / spacing, y / spacing, cv2.INTER_LINEAR), dtype=np.float32)


def find_bands(image: SearchImage, width_range_px: tuple[float, float], count: int) -> tuple[Band, ...]:
    """Dark bands with two parallel edges, best first.

    Every edge pixel votes for the line across its gradient, and only on the side to which it gets brighter; so a pair
    of lines counts only when it is darker between them (the paper's condition on the band's grey values).

    Parameters
    ----------
    width_range_px
        Smallest and largest distance of the edges, in pixels of the search image.
    count
        How many bands to return at most.
    """
    centre = 0.5 * np.array(image.grey.shape[::-1], dtype=np.float64)
    best, best_width = _best_pairs(_line_votes(image, centre), width_range_px)
    half = best.shape[1] // 2
    bands: list[Band] = []
    shortest = NAIL_BAND_SEARCH.shortest_edge_in_widths * width_range_px[0]
    for _ in range(count):
        row, column = np.unravel_index(int(np.argmax(best)), best.shape)
        if best[row, column] < shortest:
            break
        bands.append(
            _band_of(int(row), float(column - half), centre, float(best_width[row, column]), best[row, column])
        )
        _suppress(best, int(row), int(column), NAIL_BAND_SEARCH.suppressed_in_widths * width_range_px[0])
    return tuple(bands)


def _line_votes(image: SearchImage, centre: NDArray[np.float64]) -> NDArray[np.float32]:
    """Votes by direction of the gradient (degrees, towards the brighter side) and distance from `centre`."""
    x, y, direction_rad, weight = _edge_pixels(image)
    half = int(np.ceil(np.hypot(*centre))) + 2
    spread_deg = NAIL_BAND_SEARCH.direction_spread_deg
    turns_deg = np.arange(-spread_deg, spread_deg + 1)
    row = np.rint(np.degrees(direction_rad) + turns_deg[:, None]).astype(np.int64) % 360
    cosine, sine = _DIRECTIONS[:, row]
    distance = (x - centre[0]) * cosine + (y - centre[1]) * sine
    column = np.clip(np.rint(distance).astype(np.int64) + half, 0, 2 * half)
    shape = 360, 2 * half + 1
    weights = np.broadcast_to(weight, row.shape).ravel()
    votes = np.bincount((row * shape[1] + column).ravel(), weights, shape[0] * shape[1]).reshape(shape)
    return np.asarray(cv2.blur(votes, (3, 1), borderType=cv2.BORDER_CONSTANT) * 3.0, dtype=np.float32)


def _edge_pixels(
    image: SearchImage,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    smooth = cv2.GaussianBlur(image.grey, (0, 0), NAIL_BAND_SEARCH.gradient_smoothing_px)
    gradient_x = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3)
    gradient_y = cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3)
    square = np.ones((2 * NAIL_BAND_SEARCH.edge_border_px + 1,) * 2, np.uint8)
    inner = cv2.erode(image.valid.astype(np.uint8), square).astype(bool)
    steepness = np.hypot(gradient_x, gradient_y)
    if not inner.any():
        nothing = np.zeros(0)
        return nothing, nothing, nothing, nothing
    threshold = float(np.quantile(steepness[inner], 1.0 - NAIL_BAND_SEARCH.edge_share))
    scale = NAIL_BAND_SEARCH.gradient_levels / max(float(steepness[inner].max()), 1e-9)
    canny = cv2.Canny(
        (gradient_x * scale).astype(np.int16),
        (gradient_y * scale).astype(np.int16),
        NAIL_BAND_SEARCH.lower_threshold * threshold * scale,
        threshold * scale,
        L2gradient=True,
    )
    y, x = np.nonzero((canny > 0) & inner)
    strong = float(np.quantile(steepness[inner], NAIL_BAND_SEARCH.full_weight_quantile))
    weight = np.minimum(steepness[y, x] / strong, 1.0).astype(np.float64)
    direction = np.arctan2(gradient_y[y, x], gradient_x[y, x]).astype(np.float64)
    return x.astype(np.float64), y.astype(np.float64), direction, weight


def _best_pairs(
    votes: NDArray[np.float32], width_range_px: tuple[float, float]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Votes of the weaker edge of the best pair for each band, and the pair's distance.

    Bands are by direction across them (0..179 degrees) and distance of their middle line.
    """
    widths = np.arange(int(np.floor(width_range_px[0])), int(np.ceil(width_range_px[1])) + 1)
    margin, columns = int(widths[-1]), votes.shape[1]
    upper, lower = (np.pad(part, ((0, 0), (margin, margin))) for part in (votes[:180], votes[180:, ::-1]))
    best, best_width = np.zeros((180, columns), dtype=np.float32), np.zeros((180, columns), dtype=np.float32)
    for width in widths:
        above, below = margin + width // 2, margin - (width - width // 2)
        paired = np.minimum(upper[:, above : above + columns], lower[:, below : below + columns])
        better = paired > best
        np.copyto(best, paired, where=better)
        best_width[better] = width
    return best, best_width


def _band_of(row: int, distance: float, centre: NDArray[np.float64], width: float, length: float) -> Band:
    angle = np.radians(row)
    across = np.array([np.cos(angle), np.sin(angle)])
    along = np.array([across[1], -across[0]])
    # For odd widths the two edges lie unevenly about the middle column.
    return Band(centre + (distance + 0.5 * (width % 2) * -1.0) * across, along, width, float(length))


def _suppress(best: NDArray[np.float32], row: int, column: int, distance_px: float) -> None:
    """Take out the neighbourhood of a band; rows wrap around with the distance's sign reversed."""
    reach = int(np.ceil(distance_px))
    last = best.shape[1] - 1
    for turn in range(-NAIL_BAND_SEARCH.suppressed_deg, NAIL_BAND_SEARCH.suppressed_deg + 1):
        r = row + turn
        c = column if 0 <= r < 180 else last - column
        best[r % 180, max(c - reach, 0) : c + reach + 1] = 0.0
