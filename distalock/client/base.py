"""The bases of the client's models."""

from typing import Generic, TypeVar

from pydantic import BaseModel, ConfigDict

T = TypeVar("T")


class SentModel(BaseModel):
    """Base of what is sent; a misspelt member is refused here already."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class ReceivedModel(BaseModel):
    """Base of what is received; members that a newer gateway has besides are ignored."""

    model_config = ConfigDict(frozen=True, extra="ignore", populate_by_name=True)


class Page(ReceivedModel, Generic[T]):
    """One page of a list; `next_cursor` is None on the last."""

    items: tuple[T, ...]
    next_cursor: str | None
