"""How the ring's balls are looked at: blur is a matter of millimetres, so that finer pixels need wider surroundings."""

from dataclasses import replace
from typing import Final

import numpy as np

from shared.xray.discs import Array
from shared.xray.measurement import MeasurementSettings

DRIFT_PX: Final = 0.35
"""How far a ball may be from where a good estimate of the C-arm has placed it."""
# Of a place's standard deviation: what is known before a measurement must not outweigh it, the less as it comes from
# the same pixels.
_DOUBTS = 4.0
# Wider, and other things near balls that are not there are taken for them.
_WIDEST_DRIFT_PX = 0.8
_USUAL_PIXEL_MM = 0.235
# 6 px bring centres to the Cramer-Rao limit, 4 px to 1.09 of it: surroundings settle the slope of the background. Wider
# ones gain nothing, for there the background is no longer quadratic.
_REACH_PX = 6.0
_USUAL: Final = MeasurementSettings(reach_px=_REACH_PX)


def look(drift_px: float, pixel_mm: float, contrast_to_sd: float = _USUAL.contrast_to_sd) -> MeasurementSettings:
    """How to measure.

    Parameters
    ----------
    drift_px
        How far balls may be from where they are expected, in pixels of the usual size.
    pixel_mm
        Size of a pixel near the detector.
    contrast_to_sd
        As `MeasurementSettings` has it.
    """
    finer = max(1.0, _USUAL_PIXEL_MM / pixel_mm)
    return MeasurementSettings(
        reach_px=_USUAL.reach_px * finer,
        blur_px=_USUAL.blur_px * finer,
        drift_px=drift_px * finer,
        contrast_to_sd=contrast_to_sd,
    )


def look_widely(deviation_px: Array, pixel_mm: float) -> MeasurementSettings:
    """How to measure balls whose places are known to some standard deviations, in pixels, shape (M,)."""
    usual, widest = look(DRIFT_PX, pixel_mm), look(_WIDEST_DRIFT_PX, pixel_mm)
    return replace(usual, drift_px=np.minimum(np.hypot(usual.drift_px, _DOUBTS * deviation_px), widest.drift_px))
