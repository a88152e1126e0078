"""How far a drill clears the walls of a hole: offsets at entry and exit, their covariance, the probability to pass."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from shared.geometry.lines import Line, angle_between_rad, read_only, unit

# 8192 quasi-random samples: near the limit of 0.99 even random ones would err by no more than 0.0011.
_SAMPLES_LOG2 = 13
# 95 % quantile of the length of a standard normal vector in the plane, in closed form.
QUANTILE_95 = float(np.sqrt(-2.0 * np.log(0.05)))
_NEARLY_X = 0.8


@dataclass(frozen=True, slots=True, eq=False)
class AxisOffset:
    """How far one axis lies from another across a hole, with the uncertainty of that."""

    # Offset at the hole's entry (two directions across the axis), then at its exit, shape (4,)
    mean_mm: NDArray[np.float64]
    covariance_mm2: NDArray[np.float64]  # shape (4, 4)
    length_mm: float  # from entry to exit

    def __post_init__(self) -> None:
        if self.mean_mm.shape != (4,) or self.covariance_mm2.shape != (4, 4):
            raise ValueError(
                f"expected shapes (4,) and (4, 4), got {self.mean_mm.shape} and {self.covariance_mm2.shape}"
            )
        object.__setattr__(self, "mean_mm", read_only(self.mean_mm))
        object.__setattr__(self, "covariance_mm2", read_only(self.covariance_mm2))

    @property
    def entry_mm(self) -> float:
        """Offset at the entry."""
        return float(np.linalg.norm(self.mean_mm[:2]))

    @property
    def exit_mm(self) -> float:
        """Offset at the exit."""
        return float(np.linalg.norm(self.mean_mm[2:]))

    @property
    def entry_sd_mm(self) -> float:
        """Predicted rms of the offset's error at the entry: root of the trace of its covariance."""
        return float(np.sqrt(np.trace(self.covariance_mm2[:2, :2])))

    @property
    def axis_sd_deg(self) -> float:
        """Predicted rms of the angle's error: root of the trace of its covariance."""
        return float(np.degrees(np.sqrt(np.trace(self._slope_covariance()))))

    @property
    def entry_bound_mm(self) -> float:
        """No more than 5 % of errors at the entry are larger."""
        return QUANTILE_95 * float(np.sqrt(np.linalg.eigvalsh(self.covariance_mm2[:2, :2])[-1]))

    @property
    def axis_bound_deg(self) -> float:
        """No more than 5 % of errors of the angle are larger."""
        return QUANTILE_95 * float(np.degrees(np.sqrt(np.linalg.eigvalsh(self._slope_covariance())[-1])))

    def clearance_probability(self, hole_diameter_mm: float, drill_diameter_mm: float) -> float:
        """Probability that a drill's axis is off by at most half the play at entry *and* at exit."""
        play_mm = 0.5 * (hole_diameter_mm - drill_diameter_mm)
        if play_mm <= 0.0:
            return 0.0
        values, vectors = np.linalg.eigh(self.covariance_mm2)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        offsets = self.mean_mm + _standard_normal() @ root.T
        inside = (np.hypot(offsets[:, 0], offsets[:, 1]) <= play_mm) & (
            np.hypot(offsets[:, 2], offsets[:, 3]) <= play_mm
        )
        return float(np.mean(inside))

    def _slope_covariance(self) -> NDArray[np.float64]:
        difference = np.hstack([-np.eye(2), np.eye(2)]) / self.length_mm
        return np.asarray(difference @ self.covariance_mm2 @ difference.T)


def axis_offset_mm(
    axis: Line, other: Line, entry_mm: NDArray[np.float64], exit_mm: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Where `other` crosses the planes across `axis` through entry and exit, relative to them, shape (4,), in mm."""
    across = across_basis(axis.direction)
    parts = [across @ (other.at_plane(point, axis.direction) - point) for point in (entry_mm, exit_mm)]
    return np.concatenate(parts)


def across_basis(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Two unit vectors across a direction and each other, as rows, shape (2, 3).

    They turn with the direction, and jump only where it is 37° off the x axis: holes of guide and nail run along z.
    """
    helper = np.eye(3)[0 if abs(direction[0]) < _NEARLY_X else 1]
    first = unit(np.cross(direction, helper))
    return np.stack([first, np.cross(direction, first)])


def angle_deg(axis: Line, other: Line) -> float:
    """Angle between two axes, in degrees."""
    return float(np.degrees(angle_between_rad(axis.direction, other.direction)))


@lru_cache(maxsize=1)
def _standard_normal() -> NDArray[np.float64]:
    """Quasi-random standard normal vectors, always the same, shape (8192, 4): good to 0.001 near a chance of 0.99.

    An additive recurrence by the powers of 1/x, x being the root of x⁵ = x + 1: as even as Sobol's points for this
    purpose, without `scipy.stats`, whose import takes longer than the calibration of an image.
    """
    root = 1.1673039782614187
    steps = root ** -np.arange(1.0, 5.0)
    uniform = np.modf(0.5 + np.outer(np.arange(1.0, 2**_SAMPLES_LOG2 + 1), steps))[0]
    return read_only(ndtri(uniform))
