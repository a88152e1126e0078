"""Rows of packed shapes in the beam's frame (their layout is in `shapes`)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from shared.geometry.frames import Frame
from shared.geometry.lines import Line
from shared.geometry.transform import Transform
from simulation.scenario.frames import Beam

Floats = NDArray[np.float64]
Row = tuple[int, Floats]
Part = TypeVar("Part", bound=Frame)


@dataclass(frozen=True, slots=True, eq=False)
class Shapes:
    """Shapes with their classes: (class, row) each."""

    ellipsoids: tuple[Row, ...] = ()
    bars: tuple[Row, ...] = ()
    blocks: tuple[Row, ...] = ()
    tubes: tuple[Row, ...] = ()

    def ellipsoid_rows(self) -> Floats:
        """Shape (N, 12)."""
        return _stack(self.ellipsoids, 12)

    def bar_rows(self) -> Floats:
        """Shape (N, 10)."""
        return _stack(self.bars, 10)

    def block_rows(self) -> Floats:
        """Shape (N, 14)."""
        return _stack(self.blocks, 14)

    def block_classes(self) -> NDArray[np.int64]:
        """Shape (N,)."""
        return _classes(self.blocks)

    def tube_rows(self) -> Floats:
        """Shape (N, 8)."""
        return _stack(self.tubes, 8)

    def ellipsoid_classes(self) -> NDArray[np.int64]:
        """Shape (N,)."""
        return _classes(self.ellipsoids)

    def bar_classes(self) -> NDArray[np.int64]:
        """Shape (N,)."""
        return _classes(self.bars)

    def tube_classes(self) -> NDArray[np.int64]:
        """Shape (N,)."""
        return _classes(self.tubes)


def _stack(rows: tuple[Row, ...], width: int) -> Floats:
    return np.array([row for _, row in rows], dtype=np.float64).reshape(-1, width)


def _classes(rows: tuple[Row, ...]) -> NDArray[np.int64]:
    return np.array([kind for kind, _ in rows], dtype=np.int64)


def joined(groups: Sequence[Shapes]) -> Shapes:
    """All shapes of several groups."""
    return Shapes(
        tuple(row for g in groups for row in g.ellipsoids),
        tuple(row for g in groups for row in g.bars),
        tuple(row for g in groups for row in g.blocks),
        tuple(row for g in groups for row in g.tubes),
    )


def bar_row(
    pose: Transform[Beam, Part], axis: Line, radius_mm: float, from_mm: float, to_mm: float, slope: float = 0.0
) -> Floats:
    """Row of a round bar or cone about an axis of the part's frame; `radius_mm` is that at the axis' point."""
    return np.concatenate(
        [pose @ axis.point_mm, pose.directions(axis.direction), [radius_mm, slope, from_mm, to_mm]], dtype=np.float64
    )


def block_row(
    pose: Transform[Beam, Part],
    axis: Line,
    along: Floats,
    half_size_mm: tuple[float, float],
    from_mm: float,
    to_mm: float,
    slope: float = 0.0,
) -> Floats:
    """Row of a rectangular bar about an axis of the part's frame: half length along a direction across it, half width.

    The half width is that at the axis' point.
    """
    place = [pose @ axis.point_mm, pose.directions(axis.direction), pose.directions(along)]
    return np.concatenate([*place, [*half_size_mm, slope, from_mm, to_mm]], dtype=np.float64)


def ellipsoid_row(pose: Transform[Beam, Part], centre_mm: Floats, half_axes_mm: Floats) -> Floats:
    """Row of an ellipsoid with axes along those of the part's frame."""
    to_unit_sphere = np.diag(1.0 / half_axes_mm) @ pose.rotation.T
    return np.concatenate([pose @ centre_mm, to_unit_sphere.ravel()])
