"""How soft the focal spot makes edges that lie before or behind the nail, compared with the nail's own.

A focal spot of some size blurs edges the more, the nearer to it they are. What it does to the nail's edges is in the
fitted blur, which acts on the whole picture; but the guide's edges are softer, and those of the ring's balls sharper.
Balls have the steepest edges in the picture: with the nail's blur on them, attenuation and curve become a compromise,
holes come out too wide, and the nail too tilted.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry.calibration import CArmCalibration

# Edge of a square focal spot as fluoroscopy has it, 0.3 to 0.6 mm; pixels do not say which.
_FOCAL_SPOT_MM = 0.5
# So sharp an edge is a step from pixel to pixel; places all alike would make it jump under the fit.
_LEAST_SPREAD = 0.2


@dataclass(frozen=True, slots=True)
class Penumbra:
    """What the focal spot does at which depth.

    Attributes
    ----------
    plate_mm, nail_mm
        Depths from the focal spot: of the ring's near plate, which stands for the detector some 2 % behind it, and of
        the nail.
    spot_px
        Edge of the focal spot in pixels at the plate.
    """

    plate_mm: float
    nail_mm: float
    spot_px: float

    @staticmethod
    def beside(calibration: CArmCalibration, nail_mm: float, side_px: float) -> "Penumbra":
        """That of a C-arm, in pixels which have a side of so many image pixels, beside a nail of known depth."""
        plate_mm = float(calibration.camera_from_ring.translation_mm[2])
        px_per_mm = calibration.camera.focal_length_px / plate_mm / side_px
        return Penumbra(plate_mm, nail_mm, _FOCAL_SPOT_MM * px_per_mm)

    def width_px(self, depth_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Width of an edge's penumbra by its depth, nothing behind the plate; shape of the depths."""
        return np.asarray(self.spot_px * np.maximum(self.plate_mm / depth_mm - 1.0, 0.0))

    def spread(self, depth_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """By how much to spread the places in a pixel at which something is looked at; shape of the depths.

        The mean over these places blurs edges as a square of the pixel's size does. Spread out they add the variance
        that an edge's penumbra has more than the nail's, drawn together they take away what it has less, as far as a
        pixel has that much: the ring's balls become sharp enough on pixels of 0.17 mm and more.
        """
        more = self.width_px(depth_mm) ** 2 - self.width_px(np.array(self.nail_mm)) ** 2
        return np.asarray(np.sqrt(np.maximum(1.0 + more, _LEAST_SPREAD**2)))
