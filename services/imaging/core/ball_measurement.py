"""The image un-mirrored, and how the ring's balls are measured in it: settings, radii, measurement."""

from dataclasses import dataclass, replace

import numpy as np

from services.imaging.core.tuning import RING_MEASUREMENT
from shared.geometry.calibration import NOT_OF_THE_RING, BallCandidates
from shared.geometry.parts import RingPart
from shared.xray.aperture import UsableArea
from shared.xray.discs import Array, FloatImage
from shared.xray.measurement import BallMeasurements, Discs, MeasurementSettings, measure_balls
from shared.xray.pixel_scale import pixels_or_more
from shared.xray.tuning import BALL_MEASURING


@dataclass(frozen=True, slots=True, eq=False)
class UprightImage:
    """An un-mirrored image with its usable area and its discs.

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
    pixel_mm
        Nominal pixel pitch at the detector.
    """

    pixels: FloatImage
    area: UsableArea
    mirrored: bool
    others: BallCandidates
    margin: float
    pixel_mm: float

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


def measurement_settings(drift_mm: float, pixel_mm: float, contrast_to_sd: float | None = None) -> MeasurementSettings:
    """Settings of a measurement: blur has its size in millimetres, so finer pixels need wider surroundings.

    Parameters
    ----------
    drift_mm
        Standard deviation of the predicted places, at the detector.
    pixel_mm
        Pixel pitch at the detector.
    contrast_to_sd
        As `MeasurementSettings` has it; None for its default.
    """
    return MeasurementSettings(
        reach_px=pixels_or_more(RING_MEASUREMENT.reach_detector_mm, pixel_mm),
        blur_px=pixels_or_more(BALL_MEASURING.blur_detector_mm, pixel_mm),
        drift_px=pixels_or_more(drift_mm, pixel_mm),
        contrast_to_sd=BALL_MEASURING.contrast_to_sd if contrast_to_sd is None else contrast_to_sd,
        pixel_mm=pixel_mm,
    )


def settings_of_places(deviation_px: Array, pixel_mm: float) -> MeasurementSettings:
    """Settings for balls whose places are predicted with some standard deviations, in pixels, shape (M,)."""
    usual = measurement_settings(RING_MEASUREMENT.drift_detector_mm, pixel_mm)
    widest_px = pixels_or_more(RING_MEASUREMENT.widest_drift_detector_mm, pixel_mm)
    drift_px = np.hypot(usual.drift_px, RING_MEASUREMENT.prediction_sigmas * deviation_px)
    return replace(usual, drift_px=np.minimum(drift_px, widest_px))


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
