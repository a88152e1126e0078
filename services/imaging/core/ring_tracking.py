"""An earlier image of the same C-arm: the ring is measured where it was, and a ring that has moved is noticed."""

from dataclasses import dataclass

import numpy as np

from services.imaging.core.ball_measurement import DRIFT_PX, View, found_radii_px, look, usual_radii_px
from services.imaging.core.calibration import Start, calibrate_image, calibrate_there
from services.imaging.core.checks import unusable_reason
from services.imaging.core.nominal import NominalGeometry
from services.imaging.core.ring_search import searched_radii_px
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


SHIFT_LIMIT_MM = 1.0
TURN_LIMIT_DEG = 0.5
_GRID_MM = np.stack(np.meshgrid(np.linspace(-60.0, 60.0, 7), np.linspace(-60.0, 60.0, 7)), axis=-1).reshape(-1, 2)


@dataclass(frozen=True, slots=True)
class RingShift:
    """How the ring's plate moved in the image between two calibrations.

    Attributes
    ----------
    translation_mm, turn_deg
        Of the plate next to the detector, about its middle; measured at the plate.
    """

    translation_mm: float
    turn_deg: float

    @property
    def beyond_limits(self) -> bool:
        """Whether that is more than a C-arm that returns to an angle explains."""
        return self.translation_mm > SHIFT_LIMIT_MM or abs(self.turn_deg) > TURN_LIMIT_DEG


def ring_shift(now: CArmCalibration, before: CArmCalibration) -> RingShift | None:
    """Compare where two images show the ring's plate; None when the display shows the image another way.

    Both images must be of the same C-arm at the same angle, with the same ring.
    """
    same_display = now.mirrored is before.mirrored and now.width_px == before.width_px
    if not same_display or now.height_px != before.height_px:
        return None
    then, there = (_plate(c) @ np.array([1.0, 1.0j]) for c in (before, now))
    factor = np.vdot(then - then.mean(), there - there.mean()) / np.vdot(then - then.mean(), then - then.mean())
    px_per_mm = float(np.abs(then - then.mean()).mean() / np.hypot(*_GRID_MM.T).mean())
    moved_px = float(np.abs(there.mean() - then.mean()))
    return RingShift(moved_px / px_per_mm, float(np.degrees(np.angle(factor))))


def _plate(calibration: CArmCalibration) -> Array:
    """Pixels in which a grid on the plate appears, shape (N, 2)."""
    plane = np.column_stack([_GRID_MM, np.zeros(len(_GRID_MM))])
    return calibration.image_from_camera(calibration.camera_from_ring.points(plane))
