"""The last calibration of each position of the C-arm, on the disk: where to look first, what to compare with."""

from pathlib import Path

from pydantic import ValidationError

from services.imaging.devices.image_store import write_atomically
from shared.geometry.calibration import CArmCalibration
from shared.messages.imaging import CalibrationValues

# Chosen: positions of the C-arm that are nearer together than this share one remembered calibration.
_STEP_DEG = 5.0


class PositionStore:
    """One file for each ring and each five degrees of the C-arm's two angles.

    Parameters
    ----------
    folder
        Created with the first file.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def get(self, ring_sha256: str, primary_deg: float, secondary_deg: float) -> CArmCalibration | None:
        """The last calibration at about these angles; None when there is none or its file is damaged."""
        try:
            content = self._file(ring_sha256, primary_deg, secondary_deg).read_bytes()
            return CalibrationValues.model_validate_json(content).calibration()
        except (OSError, ValidationError, ValueError):
            return None

    def put(self, ring_sha256: str, primary_deg: float, secondary_deg: float, calibration: CArmCalibration) -> None:
        """Keep a calibration in place of the one before; raises `OSError` when the disk does not take it."""
        content = CalibrationValues.of(calibration).model_dump_json().encode()
        write_atomically(self._file(ring_sha256, primary_deg, secondary_deg), content)

    def _file(self, ring_sha256: str, primary_deg: float, secondary_deg: float) -> Path:
        primary, secondary = (round(angle / _STEP_DEG) * int(_STEP_DEG) for angle in (primary_deg, secondary_deg))
        return self._folder / f"{ring_sha256[:16]}_{primary:+04d}_{secondary:+04d}.json"
