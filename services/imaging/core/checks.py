"""Checks of an image and of its calibration against the criteria of `acceptance.py`."""

import numpy as np

from services.imaging.core.acceptance import (
    BALLS_MEASURED,
    CENTRAL_DEVIATION,
    CLIPPED,
    GREY_LEVELS,
    IMAGE_SIDE,
    NOT_FINITE,
    SMEAR,
    SOURCE_DEVIATION,
)
from services.imaging.core.ball_measurement import UprightImage
from services.imaging.core.camera_model import SourceAndField
from services.imaging.core.motion_blur import motion_blur_px
from services.imaging.core.tuning import DISTORTION_MODEL
from shared.acceptance import Criterion
from shared.errors import Reason, ReasonCode
from shared.geometry.parts import RingPart
from shared.parts.as_built import MEASURE_THE_RING, because_of_the_ring
from shared.xray.discs import FloatImage, Mask
from shared.xray.measurement import BallMeasurements, Discs

# Pixels of which grey values are counted: enough for sixteen of them, and sorted in a few milliseconds.
_SAMPLE = 25_000


def unusable_reason(pixels: FloatImage, usable: Mask) -> Reason | None:
    """Refuse what is too small, empty or clipped to be an X-ray image of anything.

    Parameters
    ----------
    pixels, usable
        Grey values and the pixels that hold X-rays, shape (rows, columns).
    """
    rows, columns = pixels.shape
    if not IMAGE_SIDE.is_met(min(rows, columns)):
        return IMAGE_SIDE.reason(f"the image has {columns} x {rows} pixels (at least {IMAGE_SIDE.limit} each way)")
    if not np.isfinite(pixels).all():
        return NOT_FINITE.reason()
    values = pixels[usable]
    levels = len(np.unique(values[:: max(1, len(values) // _SAMPLE)]))
    if not GREY_LEVELS.is_met(levels):
        return GREY_LEVELS.reason(f"the image has only {levels} different grey values (at least {GREY_LEVELS.limit})")
    return clipped_reason(values, CLIPPED)


def clipped_reason(values: FloatImage, criterion: Criterion[ReasonCode]) -> Reason | None:
    """Refuse usable pixels, shape (N,), of which too many have the brightest or the darkest grey value."""
    clipped = float(np.mean((values == values.max()) | (values == values.min())))
    if criterion.is_met(clipped):
        return None
    return criterion.reason(f"pure black or white covers {criterion.quoted(clipped)} of the image")


def balls_needed(share: Criterion[ReasonCode], ring: RingPart) -> int:
    """Balls that a criterion demands which limits their share."""
    return int(np.ceil(share.limit.value * len(ring.balls)))


def too_few_reason(measured: BallMeasurements, ring: RingPart) -> Reason | None:
    """Refuse when too few of the ring's balls could be measured to separate source and distortion."""
    count, needed = int(np.count_nonzero(measured.seen)), balls_needed(BALLS_MEASURED, ring)
    if count >= needed:
        return None
    return BALLS_MEASURED.reason(f"{count} of the ring's {len(ring.balls)} balls could be measured (at least {needed})")


def calibration_reasons(
    image: UprightImage, measured: BallMeasurements, expected: Discs, model: SourceAndField, ring_spread_mm: float
) -> tuple[Reason, ...]:
    """Reasons against a calibration, of whose ring the balls lie so far (rms) from their places; none when accepted."""
    reasons = (motion_reason(image, measured, expected), _extrapolation_reason(image, model, ring_spread_mm))
    return tuple(r for r in reasons if r is not None)


def motion_reason(image: UprightImage, measured: BallMeasurements, expected: Discs) -> Reason | None:
    """Refuse when the balls are smeared along one direction, whether or not each of them could be measured."""
    alone = ~measured.overlapped
    centre = np.where(measured.seen[:, None], measured.centre_px, expected.centre_px)
    smear_px = motion_blur_px(image.pixels, centre[alone], expected.radius_px[alone], image.pixel_mm)
    return None if SMEAR.is_met(smear_px) else SMEAR.reason(f"the balls are smeared over {SMEAR.quoted(smear_px)}")


def _extrapolation_reason(image: UprightImage, model: SourceAndField, ring_spread_mm: float) -> Reason | None:
    central_px = _central_deviation_px(image, model)
    source_mm = float(np.sqrt(np.linalg.eigvalsh(model.source_covariance_mm2)[-1]))
    if CENTRAL_DEVIATION.is_met(central_px) and SOURCE_DEVIATION.is_met(source_mm):
        return None
    displaced = because_of_the_ring(ring_spread_mm)
    return SOURCE_DEVIATION.reason(
        f"the ring's balls leave the image's middle uncertain by {CENTRAL_DEVIATION.quoted(central_px)} "
        f"and the focal spot by {SOURCE_DEVIATION.quoted(source_mm)}{displaced}",
        MEASURE_THE_RING if displaced else "",
    )


def _central_deviation_px(image: UprightImage, model: SourceAndField) -> float:
    """Largest predicted standard deviation of the distortion near the image's middle."""
    angle = np.arange(12) * np.pi / 6.0
    reach = DISTORTION_MODEL.central_reach * min(image.pixels.shape)
    around = image.centre_px + reach * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return float(model.field.standard_deviation_at(around).max())
