"""The image un-mirrored, and how the ring's balls are measured in it: settings, radii, measurement."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from shared.geometry.calibration import NOT_OF_THE_RING, BallCandidates
from shared.geometry.parts import RingPart
from shared.xray.aperture import UsableArea
from shared.xray.discs import Array, FloatImage
from shared.xray.measurement import BallMeasurements, Discs, MeasurementSettings, measure_balls


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The image un-mirrored, with what was found in it.

    Attributes
    ----------
    pixels, area
        Grey values, shape (rows, columns), and where they hold X-rays.
    mirrored
        Whether the image as received was the other way round.
    others
        Dark discs that are not the ring's.
    margin
        Identified balls of this identity minus those of the best different one.
    """

    pixels: FloatImage
    area: UsableArea
    mirrored: bool
    others: BallCandidates
    margin: float

    @property
    def centre_px(self) -> Array:
        """Middle of the usable area, shape (2,)."""
        if self.area.aperture is not None:
            return np.array(self.area.aperture.centre_px)
        rows, columns = self.pixels.shape
        return np.array([0.5 * (columns - 1), 0.5 * (rows - 1)])

    def measure(self, expected: Discs, settings: MeasurementSettings) -> BallMeasurements:
        """Measure the ring's balls, together with other discs that they touch."""
        return measure_balls(
            self.pixels,
            expected.centre_px,
            expected.radius_px,
            self.others.centre_px,
            self.others.radius_px,
            settings,
            self.area.mask,
        )


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


def found_radii_px(discs: BallCandidates, ring: RingPart) -> Array:
    """Radius of each of the ring's balls, NaN where none of the discs is it, shape (balls,)."""
    named = discs.ring_index != NOT_OF_THE_RING
    radius_px = np.full(len(ring.balls), np.nan)
    radius_px[discs.ring_index[named]] = discs.radius_px[named]
    return radius_px


def usual_radii_px(found_px: Array, ring: RingPart, otherwise_px: Array | None = None) -> Array:
    """Middle radius of the balls of each ball's size, shape (balls,).

    Parameters
    ----------
    found_px
        Radius of each ball, NaN where not found, shape (balls,); at least one is found unless `otherwise_px` is given.
    otherwise_px
        For balls of whose size none is found, shape (balls,); without it, the middle radius of all.
    """
    found = np.isfinite(found_px)
    usual_px = np.full(len(ring.balls), np.median(found_px[found])) if otherwise_px is None else otherwise_px.copy()
    for diameter in np.unique(ring.balls.diameter_mm[found]):
        same = ring.balls.diameter_mm == diameter
        usual_px[same] = np.median(found_px[same & found])
    return usual_px
