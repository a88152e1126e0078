"""Whether the ring still sits on the detector where it sat when the C-arm stood at the same angle before."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry.calibration import CArmCalibration

Array = NDArray[np.float64]

SHIFT_LIMIT_MM = 1.0
TURN_LIMIT_DEG = 0.5
_GRID_MM = np.stack(np.meshgrid(np.linspace(-60.0, 60.0, 7), np.linspace(-60.0, 60.0, 7)), axis=-1).reshape(-1, 2)


@dataclass(frozen=True, slots=True)
class RingShift:
    """How the ring's plate moved in the image between two calibrations.

    Attributes
    ----------
    translation_mm, turn_deg
        Of the plate next to the detector, about its middle; measured at the plate.
    """

    translation_mm: float
    turn_deg: float

    @property
    def beyond_limits(self) -> bool:
        """Whether that is more than a C-arm that returns to an angle explains."""
        return self.translation_mm > SHIFT_LIMIT_MM or abs(self.turn_deg) > TURN_LIMIT_DEG


def ring_shift(now: CArmCalibration, before: CArmCalibration) -> RingShift | None:
    """Compare where two images show the ring's plate; None when the display shows the image another way.

    Both images must be of the same C-arm at the same angle, with the same ring.
    """
    same_display = now.mirrored is before.mirrored and now.width_px == before.width_px
    if not same_display or now.height_px != before.height_px:
        return None
    then, there = (_plate(c) @ np.array([1.0, 1.0j]) for c in (before, now))
    factor = np.vdot(then - then.mean(), there - there.mean()) / np.vdot(then - then.mean(), then - then.mean())
    px_per_mm = float(np.abs(then - then.mean()).mean() / np.hypot(*_GRID_MM.T).mean())
    moved_px = float(np.abs(there.mean() - then.mean()))
    return RingShift(moved_px / px_per_mm, float(np.degrees(np.angle(factor))))


def _plate(calibration: CArmCalibration) -> Array:
    """Pixels in which a grid on the plate appears, shape (N, 2)."""
    plane = np.column_stack([_GRID_MM, np.zeros(len(_GRID_MM))])
    return calibration.image_from_camera(calibration.camera_from_ring.points(plane))
