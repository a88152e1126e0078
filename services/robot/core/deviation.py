"""How far two poses of the platform are apart."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from shared.geometry.hexapod import PlatformPose, rotation_of


@dataclass(frozen=True, slots=True)
class Deviation:
    """Difference of two poses: distance of the pivots, angle of the rotation between them."""

    distance_mm: float
    angle_deg: float

    def exceeds(self, tolerance: "Deviation") -> bool:
        """Whether either part is larger; NaN is."""
        return not (self.distance_mm <= tolerance.distance_mm and self.angle_deg <= tolerance.angle_deg)

    def __str__(self) -> str:
        return f"{self.distance_mm:.3f} mm and {self.angle_deg:.3f}°"


def deviation(a: PlatformPose, b: PlatformPose) -> Deviation:
    """Difference of two poses about the same pivot."""
    difference = a.as_array() - b.as_array()
    between = rotation_of(a.as_array()[3:]).T @ rotation_of(b.as_array()[3:])
    if not np.isfinite(between).all():
        return Deviation(float("nan"), float("nan"))
    angle_rad = Rotation.from_matrix(between).magnitude()
    return Deviation(float(np.linalg.norm(difference[:3])), float(np.degrees(angle_rad)))
