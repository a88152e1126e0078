"""Which pixels of the nail's openings are covered by something of unknown shape: a K-wire, a drill, an instrument.

The fit knows balls, the guide's body and the nail. A wire's stub in an opening it would take for the hole's rim, and
tilt the nail to explain it; so such pixels, and what the stub's blur may reach, are to be left out of the fit.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from services.registration.core.nail.coarse_outline import Opening
from shared.geometry.calibration import CArmCalibration

_INSIDE_RIM_PX = 2.0
_OPEN_PX = 3.0
_METAL_PX = (4.0, 10.0)
_DARK_SHARE = 0.55
_LEAST_STUB_PX = 6
_REACH_MM = 1.45
_BALL_MARGIN_PX = 2.0


def covered_pixels(
    pixels: NDArray[np.generic],
    calibration: CArmCalibration,
    openings: tuple[Opening, ...],
    depth_mm: float,
    known_discs_px: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Mask of what to leave out of the nail's fit, shape (height, width); empty when the openings are clear.

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
    stubs = np.zeros(pixels.shape, dtype=np.uint8)
    for opening in openings:
        _add_stub(stubs, pixels, calibration, opening, known_discs_px)
    if not stubs.any():
        return np.zeros(pixels.shape, dtype=bool)
    reach_px = int(np.ceil(_REACH_MM * calibration.camera.focal_length_px / depth_mm))
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach_px + 1, 2 * reach_px + 1))
    return np.asarray(cv2.dilate(stubs, kernel) > 0)


def _add_stub(
    stubs: NDArray[np.uint8],
    pixels: NDArray[np.generic],
    calibration: CArmCalibration,
    opening: Opening,
    known_discs_px: NDArray[np.float64],
) -> None:
    """Mark pixels inside the rim that are as dark as the metal around it and not part of a known ball."""
    centre = calibration.distortion.distort(opening.ellipse.centre_px)
    reach = int(np.ceil(opening.ellipse.semi_axes_px[0] + _METAL_PX[1]))
    left, top = (max(int(np.rint(c)) - reach, 0) for c in centre)
    right, bottom = (int(np.rint(c)) + reach + 1 for c in centre)
    block = pixels[top:bottom, left:right].astype(np.float64)
    y, x = np.mgrid[top : top + block.shape[0], left : left + block.shape[1]]
    places = np.stack([x, y], axis=-1).reshape(-1, 2).astype(np.float64)
    outside_px = opening.ellipse.signed_distance_px(calibration.distortion.undistort(places)).reshape(block.shape)
    metal = (outside_px > _METAL_PX[0]) & (outside_px < _METAL_PX[1])
    if not metal.any() or not (outside_px < -_OPEN_PX).any():
        return
    bright = float(np.percentile(block[outside_px < -_OPEN_PX], 70))
    dark = float(np.percentile(block[metal], 20))
    stub = (block < _DARK_SHARE * bright + (1.0 - _DARK_SHARE) * dark) & (outside_px < -_INSIDE_RIM_PX)
    for ball_x, ball_y, radius in _near(known_discs_px, centre, reach):
        stub &= np.hypot(x - ball_x, y - ball_y) > radius + _BALL_MARGIN_PX
    if np.count_nonzero(stub) >= _LEAST_STUB_PX:
        stubs[top:bottom, left:right] |= stub.astype(np.uint8)


def _near(discs_px: NDArray[np.float64], centre_px: NDArray[np.float64], reach_px: int) -> NDArray[np.float64]:
    """Those discs, margin included, that may touch a square about a centre."""
    away = np.abs(discs_px[:, :2] - centre_px).max(axis=1)
    return np.asarray(discs_px[away < reach_px + 1.0 + discs_px[:, 2] + _BALL_MARGIN_PX])
