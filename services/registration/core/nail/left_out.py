"""Pixels that are left out of the nail's fit: cut off, covered by something unknown, darker than any nail explains."""

import cv2
import numpy as np
from numpy.typing import NDArray

from services.registration.core.estimation.robust import robust_spread
from services.registration.core.nail.region import FitInput, FitRegion
from services.registration.core.nail.search.outline import Opening
from services.registration.core.tuning import FOREIGN_OBJECTS, OPENING_COVER
from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import NailPart, hole_surface_points
from shared.geometry.transform import Transform
from shared.xray.pixel_scale import pixels as pixels_of
from shared.xray.pixel_scale import whole_pixels


def clipped_pixels(pixels: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Pixels at the image's least grey value, or so near it that their noise was cut off, shape of the image.

    Metal is what is cut off. There no edge has the profile that its blur gives it: with these pixels in the fit, an
    image of which 5 % are black is localised up to 1.6° off. Without them the other half of each edge determines the
    pose. Background at the white end costs nothing: the model's background is as flat.
    """
    black = (pixels <= pixels.min()).astype(np.float32)
    window = (FOREIGN_OBJECTS.black_window_px,) * 2
    share = cv2.boxFilter(black, -1, window, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(share > FOREIGN_OBJECTS.largest_black_share)


def covered_pixels(
    pixels: NDArray[np.generic],
    calibration: CArmCalibration,
    openings: tuple[Opening, ...],
    depth_mm: float,
    known_discs_px: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Mask of what to leave out of the nail's fit, shape (height, width); all False when the openings are clear.

    Parameters
    ----------
    pixels
        Un-mirrored image, shape (height, width), darker is denser.
    openings
        The nail's openings as the coarse search measured them.
    depth_mm
        Depth of the nail, for the reach of the mask in pixels.
    known_discs_px
        Balls whose place is known and modelled: centre x, y and radius in measured pixels, shape (B, 3).
    """
    stubs = np.zeros(pixels.shape, dtype=bool)
    for opening in openings:
        _add_stub(stubs, pixels, calibration, opening, known_discs_px)
    if not stubs.any():
        return stubs
    reach_px = int(np.ceil(OPENING_COVER.reach_mm * calibration.camera.focal_length_px / depth_mm))
    return widened(stubs, reach_px)


def _add_stub(
    stubs: NDArray[np.bool_],
    pixels: NDArray[np.generic],
    calibration: CArmCalibration,
    opening: Opening,
    known_discs_px: NDArray[np.float64],
) -> None:
    """Mark pixels inside the rim that are as dark as the metal around it and not part of a known ball."""
    s = OPENING_COVER
    inside_px, open_px, metal_from_px, metal_to_px, margin_px = (
        pixels_of(length_mm, calibration.pixel_mm)
        for length_mm in (
            s.inside_rim_detector_mm,
            s.open_detector_mm,
            s.metal_from_detector_mm,
            s.metal_to_detector_mm,
            s.ball_margin_detector_mm,
        )
    )
    centre = calibration.distortion.distort(opening.ellipse.centre_px)
    reach = int(np.ceil(opening.ellipse.reach_px + metal_to_px))
    left, top = (max(int(np.rint(c)) - reach, 0) for c in centre)
    right, bottom = (int(np.rint(c)) + reach + 1 for c in centre)
    block = pixels[top:bottom, left:right].astype(np.float64)
    y, x = np.mgrid[top : top + block.shape[0], left : left + block.shape[1]]
    places = np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.float64)
    outside_px = opening.ellipse.signed_distance_px(calibration.distortion.undistort(places)).reshape(block.shape)
    metal = (outside_px > metal_from_px) & (outside_px < metal_to_px)
    if not metal.any() or not (outside_px < -open_px).any():
        return
    bright = float(np.percentile(block[outside_px < -open_px], s.bright_percentile))
    dark = float(np.percentile(block[metal], s.dark_percentile))
    stub = (block < s.dark_share * bright + (1.0 - s.dark_share) * dark) & (outside_px < -inside_px)
    away = np.abs(known_discs_px[:, :2] - centre).max(axis=1)
    for ball_x, ball_y, radius in known_discs_px[away < reach + 1.0 + known_discs_px[:, 2] + margin_px]:
        stub &= np.hypot(x - ball_x, y - ball_y) > radius + margin_px
    if np.count_nonzero(stub) >= s.least_pixels:
        stubs[top:bottom, left:right] |= stub


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
    found = foreign_in_region(region, residual, variance)
    margin_px = whole_pixels(FOREIGN_OBJECTS.margin_detector_mm, region.sampling.pixel_mm)
    mask = np.zeros(image_shape, dtype=bool)
    left, top = (int(v) for v in region.origin_px)
    mask[top : top + region.shape[0], left : left + region.shape[1]] = widened(found, margin_px)
    return mask


def foreign_in_region(
    region: FitRegion, residual: NDArray[np.float64], variance: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """The same without a margin, shape of the region's rectangle."""
    s = FOREIGN_OBJECTS
    smooth = region.smoothed(residual / np.sqrt(variance), pixels_of(s.blur_detector_mm, region.sampling.pixel_mm))
    limit = s.limit_in_spreads * robust_spread(region.compared_values(smooth))
    dark = (smooth < -limit).astype(np.uint8)
    _, labels, sizes, _ = cv2.connectedComponentsWithStats(dark, connectivity=8)
    large = np.flatnonzero(sizes[:, cv2.CC_STAT_AREA] >= s.least_pixels)
    return np.isin(labels, large[large > 0])


def widened(mask: NDArray[np.bool_], margin_px: int) -> NDArray[np.bool_]:
    """A mask with a margin in all directions."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * margin_px + 1, 2 * margin_px + 1))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), kernel) > 0)


def beyond_foreign(region: FitRegion, nail: NailPart, foreign: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Pixels beside the nail that lie beyond foreign ones, as seen from it, shape of the image.

    The background is smooth, and takes up what is flat beyond an object's edge.
    """
    rows, columns = np.divmod(region.compared, region.shape[1])
    left, top = (int(v) for v in region.origin_px)
    rows, columns = rows + top, columns + left
    place = np.floor(region.along_mm / FOREIGN_OBJECTS.stretch_mm).astype(np.int64)
    place = 2 * (place - place.min()) + (region.across_mm > 0.0)
    away = np.abs(region.across_mm)
    beside = foreign[rows, columns] & (away > nail.radius_mm)
    nearest = np.full(int(place.max()) + 1, np.inf)
    np.minimum.at(nearest, place[beside], away[beside])
    mask = np.zeros_like(foreign)
    beyond = away >= nearest[place]
    mask[rows[beyond], columns[beyond]] = True
    return mask


def around_holes(fit_input: FitInput, camera_from_nail: Transform[Camera, Nail]) -> NDArray[np.bool_]:
    """Surroundings of the holes, inside the nail's edges, shape of the image."""
    image, calibration = np.zeros(fit_input.pixels.shape, np.uint8), fit_input.calibration
    for hole in fit_input.nail.holes:
        middle = np.mean(hole_surface_points(fit_input.nail, hole), axis=0)
        radius_mm = 0.5 * hole.diameter_mm * FOREIGN_OBJECTS.around_hole_in_radii
        count = 1 + int(np.ceil(2.0 * hole.half_slot_mm / hole.diameter_mm))
        for shift_mm in np.linspace(-hole.half_slot_mm, hole.half_slot_mm, 2 * count - 1):
            centre = camera_from_nail @ (middle + shift_mm * hole.along_nail())
            x, y = (round(float(v)) for v in calibration.image_from_camera(centre))
            radius_px = radius_mm * calibration.camera.focal_length_px / float(centre[2])
            cv2.circle(image, (x, y), round(radius_px), 1, cv2.FILLED)
    return image > 0
