"""What is remembered of a C-arm from image to image, and from day to day."""

from dataclasses import dataclass

from services.imaging.core.ring_tracking import RingShift, ring_shift
from services.imaging.core.tuning import RING_TRACKING
from services.imaging.devices.position_store import PositionStore
from shared.geometry.calibration import CArmCalibration

Angles = tuple[float, float]


@dataclass(slots=True, eq=False)
class _Last:
    ring_sha256: str
    angles_deg: Angles | None
    calibration: CArmCalibration


class CArmMemory:
    """The newest calibration, and the last one of every position that the C-arm's images name.

    Parameters
    ----------
    positions
        Where positions are kept.
    """

    def __init__(self, positions: PositionStore) -> None:
        self._positions = positions
        self._last: _Last | None = None

    def before(self, ring_sha256: str, angles_deg: Angles | None) -> CArmCalibration | None:
        """Where an image at these angles may show this ring; None when nothing is known."""
        last = self._last
        if last is not None and last.ring_sha256 == ring_sha256 and last.angles_deg == angles_deg:
            return last.calibration
        stored = None if angles_deg is None else self._positions.get(ring_sha256, *angles_deg)
        if stored is None and last is not None and last.ring_sha256 == ring_sha256:
            return last.calibration
        return stored

    def after(self, ring_sha256: str, angles_deg: Angles | None, calibration: CArmCalibration) -> str | None:
        """Remember an accepted calibration; a sentence when the ring sits elsewhere than it did at these angles.

        Raises
        ------
        OSError
            When the disk does not take it.
        """
        self._last = _Last(ring_sha256, angles_deg, calibration)
        if angles_deg is None:
            return None
        stored = self._positions.get(ring_sha256, *angles_deg)
        shift = None if stored is None else ring_shift(calibration, stored)
        moved = shift is not None and shift.beyond_limits
        if shift is None or moved:
            self._positions.put(ring_sha256, *angles_deg, calibration)
        return _sentence(shift, angles_deg) if shift is not None and moved else None


def _sentence(shift: RingShift, angles_deg: Angles) -> str:
    primary, secondary = angles_deg
    limits = f"{RING_TRACKING.shift_limit_mm:g} mm, {RING_TRACKING.turn_limit_deg:g} deg"
    return (
        f"the ring sits {shift.translation_mm:.1f} mm and {shift.turn_deg:+.1f} deg from where it sat when the C-arm "
        f"stood at {primary:.0f}/{secondary:.0f} deg before (limits {limits}); "
        "check that it is fastened, and take new images if it moved within the case"
    )
