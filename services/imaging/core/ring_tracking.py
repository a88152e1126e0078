"""An earlier image of the same C-arm: the ring is measured where it was, and a ring that has moved is noticed."""

from dataclasses import dataclass

import numpy as np

from services.imaging.core.ball_measurement import UprightImage, found_radii_px, measurement_settings, usual_radii_px
from services.imaging.core.calibration import Start, calibrate_image, calibrate_there
from services.imaging.core.checks import unusable_reason
from services.imaging.core.nominal import NominalGeometry
from services.imaging.core.ring_search import searched_radii_px
from services.imaging.core.tuning import RING_DETECTION, RING_MEASUREMENT, RING_TRACKING
from shared.errors import Accepted, Rejected
from shared.geometry.calibration import NOT_OF_THE_RING, BallCandidates, CArmCalibration
from shared.geometry.parts import RingPart
from shared.xray.aperture import find_usable_area
from shared.xray.detection import DetectionLimits, detect_balls
from shared.xray.discs import Array, FloatImage
from shared.xray.measurement import Discs
from shared.xray.pixel_scale import USUAL_PIXEL_MM
from shared.xray.pixel_scale import pixels as pixels_at_detector


def calibrate_next(
    pixels: FloatImage, ring: RingPart, nominal: NominalGeometry, before: CArmCalibration | None
) -> Accepted[CArmCalibration] | Rejected:
    """Calibrate an image that may show the ring where an earlier image showed it.

    The balls are measured where they were. The result is accepted when three quarters of the balls are there again
    and fit one C-arm as well as before; it depends on this image's measurements alone. Else the ring is searched.

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
    floor_px = pixels_at_detector(RING_TRACKING.residual_floor_detector_mm, before.pixel_mm)
    limit = RING_TRACKING.residual_growth * max(before.distortion_residual_px, floor_px)
    return (
        now.balls_found >= RING_TRACKING.least_balls_kept * before.balls_found and now.distortion_residual_px <= limit
    )


def _followed(
    pixels: FloatImage, ring: RingPart, nominal: NominalGeometry, before: CArmCalibration
) -> Accepted[CArmCalibration] | Rejected | None:
    """Calibration at the ring's earlier place; None when a quick test shows that it is no longer there."""
    upright = np.ascontiguousarray(pixels[:, ::-1] if before.mirrored else pixels, dtype=np.float32)
    if not still_dark(upright, before.balls, nominal.pixel_mm):
        return None
    area = find_usable_area(upright)
    if (unusable := unusable_reason(upright, area.mask)) is not None:
        return Rejected((unusable,))
    expected = Discs(
        before.image_from_camera(before.camera_from_ring.points(ring.balls.position_mm)), _radii_before(ring, before)
    )
    radii = searched_radii_px(ring, nominal)
    others = detect_balls(
        upright,
        area.mask,
        radii,
        DetectionLimits(most=RING_DETECTION.most_others),
        expected.centre_px,
        nominal.pixel_mm,
    )
    image = UprightImage(upright, area, before.mirrored, others, before.runner_up_margin, nominal.pixel_mm)
    start = Start(before.camera_from_ring.inverse().translation_mm)
    settings = measurement_settings(RING_MEASUREMENT.drift_detector_mm, nominal.pixel_mm)
    return calibrate_there(image, expected, settings, ring, nominal, start)


def still_dark(pixels: FloatImage, balls: BallCandidates, pixel_mm: float = USUAL_PIXEL_MM) -> bool:
    """Whether most places of the ring's balls are darker than what is around them.

    Elsewhere that holds for half of them by chance. Only the measurement, which takes a hundred times as long,
    determines whether a ball is there.
    """
    named = balls.ring_index != NOT_OF_THE_RING
    beside_px = pixels_at_detector(RING_TRACKING.beside_detector_mm, pixel_mm)
    centre, reach = balls.centre_px[named], balls.radius_px[named] + beside_px
    angle_rad = np.arange(RING_TRACKING.directions) * 2.0 * np.pi / RING_TRACKING.directions
    rose = np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=1)
    around = centre[:, None] + reach[:, None, None] * rose
    beside = _grey(pixels, around).mean(axis=1)
    return bool(np.mean(_grey(pixels, centre[:, None] + rose).mean(axis=1) < beside) > RING_TRACKING.least_balls_kept)


def _grey(pixels: FloatImage, places_px: Array) -> FloatImage:
    """Grey values at places (x, y), shape (..., 2); those outside the image take that of its border."""
    last = np.array(pixels.shape[::-1]) - 1
    x, y = np.moveaxis(np.clip(np.round(places_px).astype(np.int64), 0, last), -1, 0)
    return np.asarray(pixels[y, x])


def _radii_before(ring: RingPart, before: CArmCalibration) -> Array:
    """Radii of the ring's balls in the earlier image; those not seen there look like the others of their size."""
    found_px = found_radii_px(before.balls, ring)
    return np.where(np.isfinite(found_px), found_px, usual_radii_px(found_px, ring))


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
        return self.translation_mm > RING_TRACKING.shift_limit_mm or abs(self.turn_deg) > RING_TRACKING.turn_limit_deg


def ring_shift(now: CArmCalibration, before: CArmCalibration) -> RingShift | None:
    """Compare where two images show the ring's plate; None when the display shows the image another way.

    Both images must be of the same C-arm at the same angle, with the same ring.
    """
    same_display = now.mirrored is before.mirrored and now.width_px == before.width_px
    if not same_display or now.height_px != before.height_px:
        return None
    then, there = (_plate(c) @ np.array([1.0, 1.0j]) for c in (before, now))
    factor = np.vdot(then - then.mean(), there - there.mean()) / np.vdot(then - then.mean(), then - then.mean())
    px_per_mm = float(np.abs(then - then.mean()).mean() / np.hypot(*_plate_mm().T).mean())
    moved_px = float(np.abs(there.mean() - then.mean()))
    return RingShift(moved_px / px_per_mm, float(np.degrees(np.angle(factor))))


def square_grid_mm(half_side_mm: float, count: int) -> Array:
    """Places on a square about the ring's middle, `count` along each side, shape (N, 2)."""
    along_mm = np.linspace(-half_side_mm, half_side_mm, count)
    return np.stack(np.meshgrid(along_mm, along_mm), axis=-1).reshape(-1, 2)


def _plate_mm() -> Array:
    return square_grid_mm(RING_TRACKING.plate_half_side_mm, RING_TRACKING.plate_places)


def _plate(calibration: CArmCalibration) -> Array:
    """Pixels in which a grid on the plate appears, shape (N, 2)."""
    plane = np.pad(_plate_mm(), ((0, 0), (0, 1)))
    return calibration.image_from_camera(calibration.camera_from_ring.points(plane))
