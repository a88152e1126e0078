"""While fluoroscopy runs, the ring is where it was: look there first, and search only when it is not."""

import numpy as np

from services.imaging.core.calibration import Start, calibrate_image, calibrate_there
from services.imaging.core.image_checks import unusable_reason
from services.imaging.core.look import DRIFT_PX, look
from services.imaging.core.nominal import NominalGeometry
from services.imaging.core.ring_radii import found_radii_px, usual_radii_px
from services.imaging.core.ring_search import searched_radii_px
from services.imaging.core.view import View
from shared.errors import Accepted, Rejected
from shared.geometry.calibration import NOT_OF_THE_RING, BallCandidates, CArmCalibration
from shared.geometry.parts import RingPart
from shared.xray.aperture import find_usable_area
from shared.xray.detection import DetectionLimits, detect_balls
from shared.xray.discs import Array, FloatImage
from shared.xray.measurement import Discs

_LEAST_OF_BEFORE = 0.75
_LARGER_RESIDUAL = 2.0
_RESIDUAL_FLOOR_PX = 0.05
_BESIDE_PX = 3.0
_ROSE = np.stack([np.cos(np.arange(8) * np.pi / 4.0), np.sin(np.arange(8) * np.pi / 4.0)], axis=1)
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
) -> Accepted[CArmCalibration] | Rejected | None:
    """What comes of looking where the ring was; None when a glance shows that it is no longer there."""
    upright = np.ascontiguousarray(pixels[:, ::-1] if before.mirrored else pixels, dtype=np.float32)
    if not still_dark(upright, before.balls):
        return None
    area = find_usable_area(upright)
    if (unusable := unusable_reason(upright, area.mask)) is not None:
        return Rejected((unusable,))
    expected = Discs(
        before.image_from_camera(before.camera_from_ring.points(ring.balls.position_mm)), _radii_before(ring, before)
    )
    radii = searched_radii_px(ring, nominal)
    others = detect_balls(upright, area.mask, radii, _OTHERS, expected.centre_px)
    view = View(upright, area, before.mirrored, others, before.runner_up_margin)
    start = Start(before.camera_from_ring.inverse().translation_mm)
    return calibrate_there(view, expected, look(DRIFT_PX, nominal.pixel_mm), ring, nominal, start)


def still_dark(pixels: FloatImage, balls: BallCandidates) -> bool:
    """Whether most places of the ring's balls are darker than what is around them.

    Elsewhere that is a matter of chance: half of them. Whether a ball is there is for the measurement to say, which
    takes a hundred times as long.
    """
    named = balls.ring_index != NOT_OF_THE_RING
    centre, reach = balls.centre_px[named], balls.radius_px[named] + _BESIDE_PX
    around = centre[:, None] + reach[:, None, None] * _ROSE
    beside = _grey(pixels, around).mean(axis=1)
    return bool(np.mean(_grey(pixels, centre[:, None] + _ROSE).mean(axis=1) < beside) > _LEAST_OF_BEFORE)


def _grey(pixels: FloatImage, places_px: Array) -> FloatImage:
    """Grey values at places (x, y), shape (..., 2); those outside the image take that of its border."""
    last = np.array(pixels.shape[::-1]) - 1
    x, y = np.moveaxis(np.clip(np.round(places_px).astype(np.int64), 0, last), -1, 0)
    return np.asarray(pixels[y, x])


def _radii_before(ring: RingPart, before: CArmCalibration) -> Array:
    """Radii of the ring's balls in the earlier image; those not seen there look like the others of their size."""
    found_px = found_radii_px(before.balls, ring)
    return np.where(np.isfinite(found_px), found_px, usual_radii_px(found_px, ring))
