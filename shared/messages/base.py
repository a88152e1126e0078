"""What all messages share: frozen, no unknown keys, finite numbers, JSON on the wire, a schema name with a version."""

from typing import Annotated, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from scipy.spatial.transform import RigidTransform, Rotation

from shared.errors import InputError, Reason, ReasonCode
from shared.geometry.transform import From, To, Transform

Finite = Annotated[float, Field(allow_inf_nan=False)]
Pixel = tuple[Finite, Finite]  # column and row
Vector3 = tuple[Finite, Finite, Finite]
Quaternion = tuple[Finite, Finite, Finite, Finite]
Matrix3 = tuple[Vector3, Vector3, Vector3]
Row4 = tuple[Finite, Finite, Finite, Finite]
Matrix4 = tuple[Row4, Row4, Row4, Row4]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Identifier = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")]
UnixNanoseconds = Annotated[int, Field(ge=0)]
Verdict = Literal["accepted", "rejected"]


def is_empty(values: tuple[object, ...]) -> bool:
    """Whether an optional list has nothing to print."""
    return not values


class WireModel(BaseModel):
    """Base of everything on the wire."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True, serialize_by_alias=True)


class Message(WireModel):
    """Base of every message; concrete classes set `schema_name` to a literal such as ``distalock/frame/1``."""


class MessageInvalid(InputError):
    """Bytes from the bus are not the message they should be."""

    code = "message_invalid"


M = TypeVar("M", bound=WireModel)


def encode(message: WireModel) -> bytes:
    """Message to JSON bytes."""
    return message.model_dump_json(by_alias=True).encode()


def decode(model: type[M], content: bytes) -> M:
    """JSON bytes to a message.

    Raises
    ------
    MessageInvalid
        With the first thing that is wrong.
    """
    try:
        return model.model_validate_json(content)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(p) for p in first["loc"]) or "message"
        raise MessageInvalid(f"not a valid {model.__name__}: {place}: {first['msg']}") from None


class ReasonMessage(WireModel):
    """A reason for a refusal."""

    code: ReasonCode
    message: str

    @staticmethod
    def of(reason: Reason) -> "ReasonMessage":
        """From the core's value."""
        return ReasonMessage(code=reason.code, message=reason.message)


class TransformMessage(WireModel):
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
