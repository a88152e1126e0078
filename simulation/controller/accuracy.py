"""How the platform differs from what the encoders report: smooth in the pose, the same every time, seeded."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from shared.geometry.hexapod import PlatformPose

ACCURACY_MM = 0.05
ACCURACY_DEG = 0.02
_WAVELENGTH = 8.0


@dataclass(frozen=True, slots=True, eq=False)
class PlatformError:
    """Systematic error of the platform: a wave through the workspace per axis.

    Attributes
    ----------
    amplitude
        Greatest error of X Y Z (mm) and U V W (degrees), shape (6,).
    waves_rad
        Wave vector of each axis' error, per mm and per degree, shape (6, 6).
    phase_rad
        Shape (6,).
    """

    amplitude: NDArray[np.float64]
    waves_rad: NDArray[np.float64]
    phase_rad: NDArray[np.float64]

    def true_pose(self, measured: PlatformPose) -> PlatformPose:
        """Where the platform really is when the encoders report `measured`."""
        values = measured.as_array()
        return PlatformPose.from_array(values + self.amplitude * np.sin(self.waves_rad @ values + self.phase_rad))


def perfect() -> PlatformError:
    """No error."""
    return PlatformError(np.zeros(6), np.zeros((6, 6)), np.zeros(6))


def seeded(seed: int) -> PlatformError:
    """The product's accuracy: at most 0.05 mm of displacement and 0.02 degrees about each axis."""
    random = np.random.default_rng(seed)
    directions = random.normal(size=(6, 6))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    each_mm = ACCURACY_MM / np.sqrt(3.0)
    amplitude = np.array([each_mm] * 3 + [ACCURACY_DEG] * 3)
    return PlatformError(amplitude, 2.0 * np.pi / _WAVELENGTH * directions, random.uniform(0.0, 2.0 * np.pi, 6))
