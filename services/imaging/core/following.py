"""While fluoroscopy runs, the ring is where it was: look there first, and search only when it is not."""

import numpy as np

from services.imaging.core.calibration import Start, calibrate_image, calibrate_there
from services.imaging.core.image_checks import unusable_reason
from services.imaging.core.nominal import NominalGeometry
from services.imaging.core.ring_search import searched_radii_px
from services.imaging.core.view import View
from shared.errors import Accepted, Rejected
from shared.geometry.calibration import NOT_OF_THE_RING, CArmCalibration
from shared.geometry.parts import RingPart
from shared.xray.aperture import find_usable_area
from shared.xray.detection import DetectionLimits, detect_balls
from shared.xray.discs import Array, FloatImage
from shared.xray.measurement import Discs

_LEAST_OF_BEFORE = 0.75
_LARGER_RESIDUAL = 2.0
_RESIDUAL_FLOOR_PX = 0.05
_OTHERS = DetectionLimits(most=150)


def calibrate_next(
    pixels: FloatImage, ring: RingPart, nominal: NominalGeometry, before: CArmCalibration | None
) -> Accepted[CArmCalibration] | Rejected:
    """Calibrate an image that may show the ring where an earlier image showed it.

    The balls are measured where they were. What comes of it is taken when three quarters of the balls are there
    again and fit one C-arm as well as before; it rests on this image's measurements alone. Else the ring is searched.

    Parameters
    ----------
    pixels, ring, nominal
        As `calibrate_image` takes them.
    before
        Calibration of an earlier image with the same ring, or None.
    """
    if before is not None and pixels.shape == (before.height_px, before.width_px):
        followed = _followed(pixels, ring, nominal, before)
        if isinstance(followed, Accepted) and _as_good(followed.value, before):
            return followed
    return calibrate_image(pixels, ring, nominal)


def _as_good(now: CArmCalibration, before: CArmCalibration) -> bool:
    limit = _LARGER_RESIDUAL * max(before.distortion_residual_px, _RESIDUAL_FLOOR_PX)
    return now.balls_found >= _LEAST_OF_BEFORE * before.balls_found and now.distortion_residual_px <= limit


def _followed(
    pixels: FloatImage, ring: RingPart, nominal: NominalGeometry, before: CArmCalibration
) -> Accepted[CArmCalibration] | Rejected:
    upright = np.ascontiguousarray(pixels[:, ::-1] if before.mirrored else pixels, dtype=np.float32)
    area = find_usable_area(upright)
    if (unusable := unusable_reason(upright, area.mask)) is not None:
        return Rejected((unusable,))
    expected = Discs(
        before.image_from_camera(before.camera_from_ring.points(ring.balls.position_mm)), _radii_before(ring, before)
    )
    radii = searched_radii_px(ring, nominal)
    others = detect_balls(upright, area.mask, radii, _OTHERS, expected.centre_px)
    view = View(upright, area, before.mirrored, expected, others, before.runner_up_margin)
    return calibrate_there(view, expected, ring, nominal, Start(before.camera_from_ring.inverse().translation_mm))


def _radii_before(ring: RingPart, before: CArmCalibration) -> Array:
    """Radii of the ring's balls in the earlier image; those not seen there look like the others of their size."""
    balls = before.balls
    named = balls.ring_index != NOT_OF_THE_RING
    radius = np.full(len(ring.balls), np.nan)
    radius[balls.ring_index[named]] = balls.radius_px[named]
    for diameter in np.unique(ring.balls.diameter_mm):
        same = ring.balls.diameter_mm == diameter
        seen = same & np.isfinite(radius)
        usual = float(np.median(radius[seen] if seen.any() else balls.radius_px[named]))
        radius[same & ~seen] = usual
    return radius
