"""Checks of an image and of its calibration against the criteria of `acceptance.py`."""

import numpy as np

from services.imaging.core.ball_measurement import View
from services.imaging.core.camera_model import SourceAndField
from services.imaging.core.motion_blur import motion_blur_px
from shared.errors import Reason, ReasonCode
from shared.figures import figure
from shared.geometry.parts import RingPart
from shared.xray.discs import FloatImage, Mask
from shared.xray.measurement import BallMeasurements, Discs

LEAST_SIDE_PX = 256
LEAST_LEVELS = 16
CLIPPED_LIMIT = 0.6
CLIPPED_SUSPECT = 0.2
_SAMPLE = 25_000


def unusable_reason(pixels: FloatImage, usable: Mask) -> Reason | None:
    """Refuse what is too small, empty or clipped to be an X-ray image of anything.

    Parameters
    ----------
    pixels, usable
        Grey values and the pixels that hold X-rays, shape (rows, columns).
    """
    rows, columns = pixels.shape
    if min(rows, columns) < LEAST_SIDE_PX:
        return Reason(
            ReasonCode.IMAGE_UNUSABLE,
            f"the image has {columns} x {rows} pixels (at least {LEAST_SIDE_PX} each way); send the full image",
        )
    if not np.isfinite(pixels).all():
        return Reason(
            ReasonCode.IMAGE_UNUSABLE, "the image holds values that are not finite numbers (limit none); send it again"
        )
    values = pixels[usable]
    levels = len(np.unique(values[:: max(1, len(values) // _SAMPLE)]))
    if levels < LEAST_LEVELS:
        return Reason(
            ReasonCode.IMAGE_UNUSABLE,
            f"the image has only {levels} different grey values (at least {LEAST_LEVELS}); "
            "check exposure and collimation and take another image",
        )
    clipped = _clipped(values)
    return saturated_reason(clipped, CLIPPED_LIMIT) if clipped > CLIPPED_LIMIT else None


def clipped_fraction(pixels: FloatImage, usable: Mask) -> float:
    """Part of the usable pixels at the very brightest or the very darkest grey value."""
    return _clipped(pixels[usable])


def _clipped(values: FloatImage) -> float:
    return float(np.mean((values == values.max()) | (values == values.min())))


def saturated_reason(clipped: float, limit: float) -> Reason:
    """Refusal of an image in which too much is clipped."""
    return Reason(
        ReasonCode.SATURATED,
        f"{figure(100 * clipped, 100 * limit, 0)} % of the image is clipped to pure black or white (limit "
        f"{100 * limit:.0f} %); lower the exposure or collimate and take another image",
    )


LEAST_BALLS_FRACTION = 0.4
MOTION_LIMIT_PX = 4.0
CENTRAL_DEVIATION_LIMIT_PX = 0.5
SOURCE_DEVIATION_LIMIT_MM = 5.0
_CENTRAL_REACH = 0.2


def too_few_reason(measured: BallMeasurements, ring: RingPart) -> Reason | None:
    """Refuse when too few of the ring's balls could be measured to tell source and distortion apart."""
    count, needed = int(np.count_nonzero(measured.seen)), int(np.ceil(LEAST_BALLS_FRACTION * len(ring.balls)))
    if count >= needed:
        return None
    return Reason(
        ReasonCode.RING_TOO_FEW_BALLS,
        f"{count} of the ring's {len(ring.balls)} balls could be measured (at least {needed}); "
        "open the collimator or uncover the ring and take another image",
    )


def judge(view: View, measured: BallMeasurements, expected: Discs, model: SourceAndField) -> tuple[Reason, ...]:
    """Reasons against a calibration; none when it may be used."""
    reasons = (motion_reason(view, measured, expected), _extrapolation_reason(view, model))
    return tuple(r for r in reasons if r is not None)


def motion_reason(view: View, measured: BallMeasurements, expected: Discs) -> Reason | None:
    """Refuse when the balls are smeared along one direction, whether or not each of them could be measured."""
    alone = ~measured.overlapped
    centre = np.where(measured.seen[:, None], measured.centre_px, expected.centre_px)
    moved = motion_blur_px(view.pixels, centre[alone], expected.radius_px[alone])
    if moved <= MOTION_LIMIT_PX:
        return None
    return Reason(
        ReasonCode.MOTION_BLUR,
        f"the balls are smeared over {figure(moved, MOTION_LIMIT_PX, 1)} px (limit {MOTION_LIMIT_PX:g} px); hold leg "
        "and C-arm still and take another image",
    )


def _extrapolation_reason(view: View, model: SourceAndField) -> Reason | None:
    central = _central_deviation_px(view, model)
    source = float(np.sqrt(np.linalg.eigvalsh(model.source_covariance_mm2)[-1]))
    if central <= CENTRAL_DEVIATION_LIMIT_PX and source <= SOURCE_DEVIATION_LIMIT_MM:
        return None
    return Reason(
        ReasonCode.CALIBRATION_EXTRAPOLATED,
        f"the ring's balls leave the image's middle uncertain by {figure(central, CENTRAL_DEVIATION_LIMIT_PX, 2)} px "
        f"(limit {CENTRAL_DEVIATION_LIMIT_PX:g} px) and the focal spot by "
        f"{figure(source, SOURCE_DEVIATION_LIMIT_MM, 1)} mm (limit {SOURCE_DEVIATION_LIMIT_MM:g} mm); uncover the ring "
        "around the middle and take another image",
    )


def _central_deviation_px(view: View, model: SourceAndField) -> float:
    """Largest predicted standard deviation of the distortion near the image's middle."""
    angle = np.arange(12) * np.pi / 6.0
    reach = _CENTRAL_REACH * min(view.pixels.shape)
    around = view.centre_px + reach * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return float(model.field.standard_deviation_at(around).max())
