"""Accept a calibration or refuse it: few balls, motion, extrapolation."""

import numpy as np

from services.imaging.core.camera_model import SourceAndField
from services.imaging.core.motion_blur import motion_blur_px
from services.imaging.core.view import View
from shared.errors import Reason, ReasonCode
from shared.figures import figure
from shared.geometry.parts import RingPart
from shared.xray.measurement import BallMeasurements, Discs

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
