"""The method's chain on a calibrated image: guide by its pattern's axes, nail by its band, holes along the beam."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from baselines.fronto_parallel.guide import locate_guide_by_axes
from baselines.fronto_parallel.nail import locate_nail_by_band
from services.registration.core.guide.locate import GuideFit
from services.registration.core.guide_from_nail import NailEstimate
from services.registration.core.localise import (
    LocalisationResult,
    LocalisationStep,
    Parts,
    conclude,
    distal_direction,
    known_balls,
    unmirrored,
)
from services.registration.core.nail.occluders import ball_discs_px
from shared.errors import Accepted, Rejected
from shared.geometry.calibration import CArmCalibration


def localise_fronto_parallel(
    pixels: NDArray[np.float32],
    calibration: CArmCalibration,
    parts: Parts,
    completed: Callable[[LocalisationStep], None] = lambda _: None,
) -> LocalisationResult:
    """Find guide and nail as `services.registration.core.localise.localise` does; always rejected.

    The method estimates no errors of its own, so that a robot never moves by its result.

    Parameters
    ----------
    calibration
        By `baselines.fronto_parallel.calibration.calibrate_by_plates`.
    """
    guide = locate_guide_by_axes(calibration, parts.ring, parts.guide)
    completed(LocalisationStep.GUIDE)
    nail = _locate_nail(pixels, calibration, parts, guide.value if isinstance(guide, Accepted) else None)
    completed(LocalisationStep.NAIL)
    return conclude(calibration, parts, guide, nail)


def _locate_nail(
    pixels: NDArray[np.float32], calibration: CArmCalibration, parts: Parts, guide: GuideFit | None
) -> Accepted[NailEstimate] | Rejected:
    discs_px = ball_discs_px(known_balls(parts, guide), calibration)
    upright = unmirrored(pixels, calibration)
    found = locate_nail_by_band(upright, calibration, parts.nail, distal_direction(guide), discs_px)
    if isinstance(found, Rejected):
        return found
    return Accepted(NailEstimate(found.value.camera_from_nail, None, None))
