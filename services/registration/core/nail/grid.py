"""Where the fit looks: the strip along the nail's holes, and the grid of (perhaps reduced) pixels over it."""

from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from shared.geometry.calibration import CArmCalibration
from shared.geometry.frames import Camera, Nail
from shared.geometry.parts import NailPart
from shared.geometry.transform import Transform

Scalar = TypeVar("Scalar", bound=np.generic)

_LEAST_SIDE = 8


@dataclass(frozen=True, slots=True)
class Strip:
    """Part of the nail that is looked at, in the nail's frame: from x to x, and to either side of its axis, in mm."""

    first_x_mm: float
    last_x_mm: float
    half_width_mm: float


def strip_of(nail: NailPart, surroundings_mm: float) -> Strip:
    """The holes with so many mm of surroundings along and beside the nail, without the rounded tip."""
    first = min(h.axis.point_mm[0] - 0.5 * h.diameter_mm for h in nail.holes)
    last = max(h.axis.point_mm[0] + 0.5 * h.diameter_mm for h in nail.holes)
    before_tip = max(last, nail.tip_x_mm - nail.radius_mm)
    return Strip(
        float(first) - surroundings_mm, float(min(last + surroundings_mm, before_tip)), nail.radius_mm + surroundings_mm
    )


@dataclass(frozen=True, slots=True)
class PixelGrid:
    """Rectangle of the image in pixels of `reduction` squared: its first pixel's corner, and rows and columns."""

    left: int
    top: int
    shape: tuple[int, int]
    reduction: int

    @property
    def origin_px(self) -> tuple[float, float]:
        """Centre of the first reduced pixel."""
        centre = 0.5 * (self.reduction - 1)
        return self.left + centre, self.top + centre

    @property
    def axes_px(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where the reduced pixels' centres are in the image: x of the columns, and y of the rows."""
        rows, columns = (self.reduction * np.arange(count, dtype=np.float64) for count in self.shape)
        return self.origin_px[0] + columns, self.origin_px[1] + rows

    def centres_of(self, places: NDArray[np.int64]) -> NDArray[np.float64]:
        """Centres (x, y) in the image of reduced pixels at flat places, shape (N,): shape (N, 2)."""
        rows, columns = np.divmod(places, self.shape[1])
        x_px, y_px = self.axes_px
        return np.stack([x_px[columns], y_px[rows]], axis=1)

    def blocks_of(self, image: NDArray[Scalar]) -> NDArray[Scalar]:
        """What an image holds, shape (rows, reduction, columns, reduction)."""
        rows, columns = self.shape
        side = self.reduction
        block = image[self.top : self.top + rows * side, self.left : self.left + columns * side]
        return block.reshape(rows, side, columns, side)


def grid_around(
    calibration: CArmCalibration, strip: Strip, camera_from_nail: Transform[Camera, Nail], reduction: int, around: int
) -> PixelGrid | None:
    """The strip's rectangle with so many reduced pixels around it; `None` when hardly any of it is in the image."""
    corners = np.array(
        [(x, y, 0.0) for x in (strip.first_x_mm, strip.last_x_mm) for y in (-strip.half_width_mm, strip.half_width_mm)]
    )
    px = calibration.image_from_camera(camera_from_nail.points(corners))
    margin = around * reduction
    low = np.maximum(np.floor(px.min(axis=0)) - margin, 0.0).astype(int)
    limit = np.array([calibration.width_px, calibration.height_px])
    high = np.minimum(np.ceil(px.max(axis=0)) + margin + 1, limit).astype(int)
    columns, rows = (int(v) for v in (high - low) // reduction)
    if columns < _LEAST_SIDE or rows < _LEAST_SIDE:
        return None
    return PixelGrid(int(low[0]), int(low[1]), (rows, columns), reduction)
