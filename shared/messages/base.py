"""What all messages share: frozen, no unknown keys, finite numbers, JSON on the wire, a schema name with a version.

No array library is imported here, for the router needs none: `shared.messages.geometry` has what does.
"""

from typing import Annotated, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from shared.errors import InputError, Reason, ReasonCode

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


class MessageModel(BaseModel):
    """Base of everything on the wire."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True, serialize_by_alias=True)


class Message(MessageModel):
    """Base of every message; concrete classes set `schema_name` to a literal such as ``distalock/frame/1``."""


class MessageInvalid(InputError):
    """Bytes from the bus are not the message they should be."""

    code = "message_invalid"


M = TypeVar("M", bound=MessageModel)


def encode(message: MessageModel) -> bytes:
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


class ReasonMessage(MessageModel):
    """A reason for a refusal."""

    code: ReasonCode
    message: str

    @staticmethod
    def of(reason: Reason) -> "ReasonMessage":
        """From the core's value."""
        return ReasonMessage(code=reason.code, message=reason.message)
