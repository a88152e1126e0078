"""Nominal values of the C-arm: a start for the search, wrong by up to ten per cent."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.imaging.core.tuning import NOMINAL_VALUES
from shared.geometry.parts import RingPart


@dataclass(frozen=True, slots=True)
class NominalGeometry:
    """Nominal values of the C-arm.

    Attributes
    ----------
    source_to_detector_mm
        Focal spot to image plane.
    pixel_mm
        Size of a pixel at the image plane.
    focal_spot_mm
        Edge of the focal spot; None where nobody states it.
    """

    source_to_detector_mm: float = 1000.0
    pixel_mm: float = 0.235
    focal_spot_mm: float | None = None

    @property
    def source_to_ring_mm(self) -> float:
        """Focal spot to the ring's plate next to the detector."""
        return self.source_to_detector_mm * (1.0 - NOMINAL_VALUES.ring_to_image_plane)

    @property
    def ring_scale_px_per_mm(self) -> float:
        """Pixels per millimetre in the ring's plane z = 0."""
        return 1.0 / ((1.0 - NOMINAL_VALUES.ring_to_image_plane) * self.pixel_mm)

    def ball_radius_range_px(self, ring: RingPart) -> tuple[float, float]:
        """Nominal radius of the smallest and of the largest shadow of the ring's balls."""
        radius = self.ball_radii_px(ring)
        return float(np.min(radius)), float(np.max(radius))

    def ball_radii_px(self, ring: RingPart) -> NDArray[np.float64]:
        """Nominal radius of the shadow of each of the ring's balls, shape (N,)."""
        depth = self.source_to_ring_mm + ring.balls.position_mm[:, 2]
        return np.asarray(0.5 * ring.balls.diameter_mm * self.source_to_detector_mm / (depth * self.pixel_mm))
