"""Rigid transforms whose names cancel: `camera_from_guide @ guide_from_nail` is `camera_from_nail`.

Small motions are twists, shape (6,): rotation vector (rad) before translation (mm), in the moving frame `From`. `exp`
and `log` are those of SE(3) as SciPy's `RigidTransform` has them (the rotation turns the translation on its way); to
first order a twist is a rotation vector beside a translation. See J. Sola, J. Deray, D. Atchuthan, A micro Lie theory
for state estimation in robotics, arXiv:1812.01537.
"""

from dataclasses import dataclass
from typing import Generic, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from shared.geometry.frames import Frame
from shared.geometry.lines import cross_matrix

To = TypeVar("To", bound=Frame)
From = TypeVar("From", bound=Frame)
Other = TypeVar("Other", bound=Frame)

# Above the rounding of matrices in messages and files, below any error that matters: 0.001 mm at 1 m.
_ORTHONORMAL_TOLERANCE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Transform(Generic[To, From]):
    """A rigid motion that maps coordinates of frame `From` to coordinates of frame `To`, in millimetres."""

    rigid: RigidTransform

    @staticmethod
    def identity() -> "Transform[To, From]":
        """Both frames coincide."""
        return Transform(RigidTransform.identity())

    @staticmethod
    def from_matrix(matrix: ArrayLike) -> "Transform[To, From]":
        """Build from a homogeneous matrix.

        Parameters
        ----------
        matrix
            Shape (4, 4), column-vector convention, translation in mm.

        Raises
        ------
        ValueError
            When the shape is not (4, 4), or the rotation block is not right-handed and orthonormal within 1e-6.
        """
        m = np.asarray(matrix, dtype=np.float64)
        if m.shape != (4, 4):
            raise ValueError(f"expected a homogeneous matrix of shape (4, 4), got {m.shape}")
        deviation = float(np.abs(m[:3, :3] @ m[:3, :3].T - np.eye(3)).max())
        if deviation > _ORTHONORMAL_TOLERANCE or np.linalg.det(m[:3, :3]) < 0:
            raise ValueError(
                f"rotation block is not right-handed orthonormal: |R R' - I| = {deviation:.2g} "
                f"(limit {_ORTHONORMAL_TOLERANCE:g}), det = {np.linalg.det(m[:3, :3]):+.3f}"
            )
        return Transform.from_rotation_translation(m[:3, :3], m[:3, 3])

    @staticmethod
    def from_rotation_translation(rotation: ArrayLike, translation_mm: ArrayLike) -> "Transform[To, From]":
        """Build from a rotation matrix, shape (3, 3), and a translation, shape (3,), in mm."""
        # one homogeneous matrix is checked three times as fast as a rotation and then the two together
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation, translation_mm
        return Transform(RigidTransform.from_matrix(matrix))

    @staticmethod
    def from_rotvec(rotation_vector_rad: ArrayLike, translation_mm: ArrayLike) -> "Transform[To, From]":
        """Build from a rotation vector (axis times angle, rad), shape (3,), and a translation in mm, shape (3,)."""
        return Transform(
            RigidTransform.from_components(
                np.asarray(translation_mm, float), Rotation.from_rotvec(np.asarray(rotation_vector_rad, float))
            )
        )

    @staticmethod
    def exp(motion: ArrayLike) -> "Transform[To, From]":
        """Rigid motion of a twist (rotation vector in rad, translation in mm), shape (6,)."""
        return Transform(RigidTransform.from_exp_coords(np.asarray(motion, dtype=np.float64)))

    def log(self) -> NDArray[np.float64]:
        """Twist of which this is the exponential, shape (6,)."""
        return np.asarray(self.rigid.as_exp_coords(), dtype=np.float64)

    def moved(self, motion: ArrayLike) -> "Transform[To, From]":
        """After a small motion of `From` in its own frame, a twist of shape (6,)."""
        return Transform(self.rigid * RigidTransform.from_exp_coords(np.asarray(motion, dtype=np.float64)))

    def motion_to(self, other: "Transform[To, From]") -> NDArray[np.float64]:
        """Small motion of `From` in its own frame that leads to another transform, shape (6,)."""
        return (self.inverse() @ other).log()

    @property
    def adjoint(self) -> NDArray[np.float64]:
        """Twists in frame `From` as twists in frame `To`, shape (6, 6)."""
        matrix, rotation = np.zeros((6, 6)), self.rotation
        matrix[:3, :3] = matrix[3:, 3:] = rotation
        matrix[3:, :3] = cross_matrix(self.translation_mm) @ rotation
        return matrix

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Homogeneous matrix, shape (4, 4)."""
        return np.asarray(self.rigid.as_matrix(), dtype=np.float64)

    @property
    def rotation(self) -> NDArray[np.float64]:
        """Rotation matrix, shape (3, 3)."""
        return np.ascontiguousarray(self.matrix[:3, :3])

    @property
    def rotation_vector_rad(self) -> NDArray[np.float64]:
        """Axis times angle, shape (3,), in radians."""
        return np.asarray(self.rigid.rotation.as_rotvec(), dtype=np.float64)

    @property
    def translation_mm(self) -> NDArray[np.float64]:
        """Where the origin of `From` lies in `To`, shape (3,), in mm."""
        return np.asarray(self.rigid.translation, dtype=np.float64)

    def inverse(self) -> "Transform[From, To]":
        """Map coordinates of `To` to coordinates of `From`."""
        return Transform(self.rigid.inv())

    @overload
    def __matmul__(self, other: "Transform[From, Other]") -> "Transform[To, Other]": ...

    @overload
    def __matmul__(self, other: NDArray[np.float64]) -> NDArray[np.float64]: ...

    def __matmul__(self, other: object) -> object:
        """Chain with another transform, or map points of shape (3,) or (N, 3) in mm."""
        if isinstance(other, Transform):
            return Transform(self.rigid * other.rigid)
        return self.points(np.asarray(other, dtype=np.float64))

    def points(self, points_mm: NDArray[np.float64]) -> NDArray[np.float64]:
        """Map points, shape (..., 3), from frame `From` to frame `To`, in mm."""
        return points_mm @ self.rotation.T + self.translation_mm

    def directions(self, directions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rotate directions, shape (..., 3), from frame `From` to frame `To`."""
        return directions @ self.rotation.T
