"""Balls that lie beside the places that their part's file has: what a refusal says of them, and what to do."""

from typing import Final

from shared.xray.tuning import BALLS_AS_BUILT

MEASURE_THE_RING: Final = "measure the ring (`distalock calibrate ring`), or check that the file is that of this ring"
MEASURE_THE_GUIDE: Final = (
    "measure the guide (`distalock calibrate guide`), or check that the file is that of this guide"
)


def because_of_the_ring(spread_mm: float) -> str:
    """Clause that names the ring where its balls lie far from their places; empty elsewhere.

    Parameters
    ----------
    spread_mm
        Rms distance per axis of the ring's balls from where its calibration has them, at the detector.
    """
    return _because("ring", spread_mm, BALLS_AS_BUILT.ring_named_from_mm)


def because_of_the_guide(spread_mm: float) -> str:
    """The same of the guide, whose spread is the one that its measurement and stated tolerance do not explain."""
    return _because("guide", spread_mm, BALLS_AS_BUILT.guide_named_from_mm)


def _because(part: str, spread_mm: float, named_from_mm: float) -> str:
    if spread_mm <= named_from_mm:
        return ""
    return f"; the {part}'s balls lie {spread_mm:.2f} mm (rms per axis) from where its file has them"
