"""Round steel rods in the image, such as K-wires: what of each ray they block, and which pixels their edges touch."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from services.registration.core.compiled import compiled
from services.registration.core.nail.paths import cylinder_interval
from shared.geometry.calibration import CArmCalibration
from shared.geometry.lines import read_only

_EDGE_POINTS = 200


@dataclass(frozen=True, slots=True, eq=False)
class SteelRod:
    """A straight round rod.

    Attributes
    ----------
    start_camera_mm, end_camera_mm
        Its ends on the axis, in the camera's frame, shape (3,).
    """

    start_camera_mm: NDArray[np.float64]
    end_camera_mm: NDArray[np.float64]
    diameter_mm: float

    def __post_init__(self) -> None:
        for name in ("start_camera_mm", "end_camera_mm"):
            object.__setattr__(self, name, read_only(getattr(self, name)))

    def discs_px(self, calibration: CArmCalibration, wider_mm: float) -> NDArray[np.float64]:
        """The rod as discs along its image: centre x, y and radius in measured pixels, shape (K, 3)."""
        way = np.linspace(0.0, 1.0, _EDGE_POINTS)[:, None]
        centres_mm = (1.0 - way) * self.start_camera_mm + way * self.end_camera_mm
        radius_mm = 0.5 * self.diameter_mm + wider_mm
        radius_px = radius_mm * calibration.camera.focal_length_px / centres_mm[:, 2]
        return np.column_stack([calibration.image_from_camera(centres_mm), radius_px])


def add_rod_path(directions: NDArray[np.float64], rod: SteelRod, out_mm: NDArray[np.float64]) -> None:
    """Add the length of each ray, directions of shape (N, 2) at z = 1, in a rod to `out_mm`, shape (N,)."""
    along = rod.end_camera_mm - rod.start_camera_mm
    length_mm = float(np.linalg.norm(along))
    _add_rod_path(
        directions, np.array(rod.start_camera_mm), along / length_mm, length_mm, 0.5 * rod.diameter_mm, out_mm
    )


@compiled
def _add_rod_path(
    directions: NDArray[np.float64],
    start: NDArray[np.float64],
    along: NDArray[np.float64],
    length_mm: float,
    radius_mm: float,
    out_mm: NDArray[np.float64],
) -> None:
    for n in range(directions.shape[0]):
        cx, cy = directions[n, 0], directions[n, 1]
        near, far = cylinder_interval(
            -start[0], -start[1], -start[2], cx, cy, 1.0, along[0], along[1], along[2], radius_mm
        )
        if far <= near:
            continue
        # places along the rod: linear in the depth s, and only those between its two flat ends count
        slope = cx * along[0] + cy * along[1] + along[2]
        offset = -(start[0] * along[0] + start[1] * along[1] + start[2] * along[2])
        if abs(slope) > 0.0:
            first, second = -offset / slope, (length_mm - offset) / slope
            near, far = max(near, min(first, second)), min(far, max(first, second))
        elif offset < 0.0 or offset > length_mm:
            continue
        if far > near:
            out_mm[n] += (far - near) * np.sqrt(cx * cx + cy * cy + 1.0)
