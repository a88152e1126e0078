"""Straight lines in space: distances, angles and where they meet a plane."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


def read_only(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a contiguous copy that cannot be written to."""
    copy = np.array(values, dtype=np.float64, order="C")
    copy.setflags(write=False)
    return copy


def unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Scale vectors, shape (..., 3), to length one."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def angle_between_rad(a: NDArray[np.float64], b: NDArray[np.float64]) -> float:
    """Angle between two directions, shape (3,) each, in radians; accurate near zero (atan2, never acos)."""
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b)))


def rotations_between_rad(start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
    """Smallest rotations, as vectors in radians, that take directions to others, shape (..., 3) all three."""
    normal = np.cross(start, end)
    sine = np.linalg.norm(normal, axis=-1, keepdims=True)
    angle = np.arctan2(sine, np.sum(start * end, axis=-1, keepdims=True))
    return np.asarray(normal * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 0.0))


def displacement_by_motion(point_mm: NDArray[np.float64]) -> NDArray[np.float64]:
    """How a body's point, shape (3,), moves with a small motion of the body in its own frame, shape (3, 6).

    The motion (rotation w in rad, translation t in mm) moves the point x by w x x + t.
    """
    return np.hstack([-cross_matrix(point_mm), np.eye(3)])


def cross_matrix(v: NDArray[np.float64]) -> NDArray[np.float64]:
    """The matrix that takes a vector to the cross product of `v` with it, shape (3, 3)."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A directed line.

    Attributes
    ----------
    point_mm
        A point on the line, shape (3,).
    direction
        Unit direction, shape (3,).
    """

    point_mm: NDArray[np.float64]
    direction: NDArray[np.float64]

    def __post_init__(self) -> None:
        if self.point_mm.shape != (3,) or self.direction.shape != (3,):
            raise ValueError(f"expected shapes (3,) and (3,), got {self.point_mm.shape} and {self.direction.shape}")
        object.__setattr__(self, "point_mm", read_only(self.point_mm))
        object.__setattr__(self, "direction", read_only(unit(self.direction)))

    def distance_mm(self, point_mm: NDArray[np.float64]) -> float:
        """Distance of a point, shape (3,), from the line, in mm."""
        offset = point_mm - self.point_mm
        return float(np.linalg.norm(offset - self.direction * (offset @ self.direction)))

    def at_plane(self, plane_point_mm: NDArray[np.float64], plane_normal: NDArray[np.float64]) -> NDArray[np.float64]:
        """Point where the line meets a plane, shape (3,), in mm."""
        along = (plane_point_mm - self.point_mm) @ plane_normal / (self.direction @ plane_normal)
        return np.asarray(self.point_mm + along * self.direction)


def across_axis_offset_mm(axis: Line, other: Line, at_point_mm: NDArray[np.float64]) -> float:
    """How far `other` lies from `axis`, measured in the plane across `axis` through `at_point_mm`, in mm."""
    return axis.distance_mm(other.at_plane(at_point_mm, axis.direction))
