"""Foreign objects of steel and soft tissue, and bores in bone, in the beam's frame, as shapes of the ray tracer."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from shared.geometry.lines import unit
from simulation.render import tracer
from simulation.render.shapes import box, frustum
from simulation.render.tracer import PackedScene

Floats = NDArray[np.float64]
_SLICES_OF_BALL = 8


@dataclass(frozen=True, slots=True, eq=False)
class SteelBox:
    """A block: centre, its unit axes in rows, shape (3, 3), and half its size along each."""

    centre_mm: Floats
    axes: Floats
    half_size_mm: Floats

    @property
    def row(self) -> Floats:
        """Row of `shapes.box`."""
        return np.concatenate([self.centre_mm, self.half_size_mm])


@dataclass(frozen=True, slots=True, eq=False)
class Objects:
    """What is added to a scene.

    Attributes
    ----------
    rods
        Steel, rows of `shapes.frustum`.
    soft
        Soft tissue, rows of `shapes.ellipsoid`.
    bores
        Soft tissue where bone was, rows of `shapes.frustum`.
    """

    boxes: tuple[SteelBox, ...] = ()
    rods: tuple[Floats, ...] = ()
    soft: tuple[Floats, ...] = ()
    bores: tuple[Floats, ...] = ()

    def covered_share(self, points_mm: Floats) -> float:
        """Share of points, shape (N, 3), whose rays from the focal spot's middle meet steel."""
        return float(np.mean([self._covers(point) for point in np.ascontiguousarray(points_mm)]))

    def _covers(self, point_mm: Floats) -> bool:
        source = np.zeros(3)
        stretches = [box(b.row, b.axes, source, point_mm) for b in self.boxes]
        stretches += [frustum(row, source, point_mm) for row in self.rods]
        return any(near < far for near, far in stretches)

    def added_to(self, packed: PackedScene) -> PackedScene:
        """The scene with these objects."""
        rods, soft = np.array([*self.rods, *self.bores]).reshape(-1, 10), np.array(self.soft).reshape(-1, 12)
        rod_class = np.repeat([tracer.STEEL_PART, tracer.DRILLED], [len(self.rods), len(self.bores)])
        boxes = np.array([one.row for one in self.boxes]).reshape(-1, 6)
        axes = np.array([one.axes for one in self.boxes]).reshape(-1, 3, 3)
        return packed._replace(
            steel_boxes=np.concatenate([packed.steel_boxes, boxes]),
            steel_box_axes=np.concatenate([packed.steel_box_axes, axes]),
            bars=np.concatenate([packed.bars, rods]),
            bar_class=np.concatenate([packed.bar_class, rod_class]),
            ellipsoids=np.concatenate([packed.ellipsoids, soft]),
            ellipsoid_class=np.concatenate([packed.ellipsoid_class, np.full(len(soft), tracer.THIGH)]),
        )


def rod(from_mm: Floats, to_mm: Floats, diameter_mm: float) -> Floats:
    """Row of a round rod between two points."""
    length = float(np.linalg.norm(to_mm - from_mm))
    return np.concatenate([from_mm, (to_mm - from_mm) / length, [0.5 * diameter_mm, 0.0, 0.0, length]])


def ball(centre_mm: Floats, diameter_mm: float) -> tuple[Floats, ...]:
    """Rows of a ball, as conical slices whose walls are within 2 % of its radius."""
    latitude = np.linspace(-0.5 * np.pi, 0.5 * np.pi, _SLICES_OF_BALL + 1)
    heights, radii = 0.5 * diameter_mm * np.sin(latitude), 0.5 * diameter_mm * np.cos(latitude)
    axis = np.array([0.0, 0.0, 1.0])
    rows = []
    for k in range(_SLICES_OF_BALL):
        slope = (radii[k + 1] - radii[k]) / (heights[k + 1] - heights[k])
        at_centre = radii[k] - slope * heights[k]
        rows.append(np.concatenate([centre_mm, axis, [at_centre, slope, heights[k], heights[k + 1]]]))
    return tuple(rows)


def wire_along(points_mm: Floats, diameter_mm: float) -> tuple[Floats, ...]:
    """Rows of a bent wire through points, shape (N, 3)."""
    return tuple(rod(a, b, diameter_mm) for a, b in pairwise(points_mm))


def axes_across(ray: Floats, turn_rad: float) -> tuple[Floats, Floats]:
    """Two unit vectors across a ray and across each other; the first is turned about it by the angle."""
    first = unit(np.cross(ray, np.array([0.0, 1.0, 0.0])))
    second = np.cross(ray, first)
    turned = np.cos(turn_rad) * first + np.sin(turn_rad) * second
    return turned, np.cross(ray, turned)


def plate_with_edge(
    edge_mm: Floats, inwards: Floats, ray: Floats, size_mm: Sequence[float], tilt_rad: float
) -> SteelBox:
    """A plate whose shadow's straight edge passes through a point.

    Parameters
    ----------
    edge_mm
        A point of the edge's shadow, moved along its ray to the depth of the plate, shape (3,).
    inwards, ray
        Unit vectors across each other: from the edge into the shadow, and along the ray, shape (3,) each.
    size_mm
        Width (inwards), length (along the edge) and thickness.
    tilt_rad
        Angle about the edge between the plate and the plane across the ray.
    """
    width, length, thickness = size_mm
    along = np.cross(ray, inwards)
    across = np.cos(tilt_rad) * inwards + np.sin(tilt_rad) * ray
    reach = 0.5 * width * np.cos(tilt_rad) + 0.5 * thickness * abs(np.sin(tilt_rad))
    axes = np.array([across, along, np.cross(across, along)])
    return SteelBox(edge_mm + reach * inwards, axes, 0.5 * np.array([width, length, thickness]))
