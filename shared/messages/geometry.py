"""Transforms and arrays as they stand in messages."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import RigidTransform, Rotation

from shared.geometry.transform import From, To, Transform
from shared.messages.base import Matrix3, Matrix4, MessageInvalid, MessageModel, Pixel, Quaternion, Vector3


class TransformMessage(MessageModel):
    """A rigid transform: maps coordinates of `from_frame` to coordinates of `to_frame`."""

    to_frame: str
    from_frame: str
    rotation_wxyz: Quaternion
    translation_mm: Vector3

    @staticmethod
    def of(transform: Transform[To, From], to_frame: type[To], from_frame: type[From]) -> "TransformMessage":
        """From the core's value; the frames are named by their types."""
        wxyz = transform.rigid.rotation.as_quat(scalar_first=True)
        return TransformMessage(
            to_frame=to_frame.__name__.lower(),
            from_frame=from_frame.__name__.lower(),
            rotation_wxyz=(float(wxyz[0]), float(wxyz[1]), float(wxyz[2]), float(wxyz[3])),
            translation_mm=vector3(transform.translation_mm),
        )

    def transform(self, to_frame: type[To], from_frame: type[From]) -> Transform[To, From]:
        """To the core's value; raises `MessageInvalid` when it is a transform between other frames."""
        if (self.to_frame, self.from_frame) != (to_frame.__name__.lower(), from_frame.__name__.lower()):
            raise MessageInvalid(
                f"expected {to_frame.__name__.lower()}_from_{from_frame.__name__.lower()}, "
                f"got {self.to_frame}_from_{self.from_frame}"
            )
        w, x, y, z = self.rotation_wxyz
        norm = float(np.linalg.norm(self.rotation_wxyz))
        if abs(norm - 1.0) > 1e-6:
            raise MessageInvalid(f"rotation_wxyz has length {norm:.6f}, expected 1 within 1e-6")
        return Transform(
            RigidTransform.from_components(np.array(self.translation_mm), Rotation.from_quat([x, y, z, w]))
        )


def pixel(values: NDArray[np.float64]) -> Pixel:
    """Array of shape (2,), column and row, to a tuple of floats."""
    return (float(values[0]), float(values[1]))


def vector3(values: NDArray[np.float64]) -> Vector3:
    """Array of shape (3,) to a tuple of floats."""
    return (float(values[0]), float(values[1]), float(values[2]))


def matrix3(values: NDArray[np.float64]) -> Matrix3:
    """Array of shape (3, 3) to nested tuples, row by row."""
    return (vector3(values[0]), vector3(values[1]), vector3(values[2]))


def matrix4(transform: Transform[To, From]) -> Matrix4:
    """Homogeneous matrix of a transform as nested tuples, row by row."""
    m = transform.matrix
    rows = [(float(r[0]), float(r[1]), float(r[2]), float(r[3])) for r in m]
    return (rows[0], rows[1], rows[2], rows[3])
