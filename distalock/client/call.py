"""A request as a value: what is sent, and of which type the answer is."""

import uuid
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from typing import Generic, TypeVar
from urllib.parse import quote

from pydantic import TypeAdapter, ValidationError

from distalock.client.base import SentModel
from distalock.client.refusals import AnswerInvalid

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)


@dataclass(frozen=True, slots=True)
class Call(Generic[T_co]):
    """One request.

    Attributes
    ----------
    answer
        Type of what comes back.
    key
        `Idempotency-Key`; None where the operation has none.
    matches
        Path of the resource whose ETag is quoted in `If-Match`, as it was read last; None where none is.
    if_match
        The ETag to quote instead.
    """

    method: str
    path: str
    answer: type[T_co]
    query: tuple[tuple[str, str], ...] = ()
    body: SentModel | None = None
    key: str | None = None
    matches: str | None = None
    if_match: str | None = None

    @property
    def reads_only(self) -> bool:
        """Whether it changes nothing, so that it may be sent again without a thought."""
        return self.method == "GET"

    @property
    def content(self) -> bytes | None:
        """The body: members that nobody has set are left out, so that a change leaves them as they are."""
        return None if self.body is None else self.body.model_dump_json(exclude_unset=True, by_alias=True).encode()

    def headers(self, etags: Mapping[str, str]) -> dict[str, str]:
        """What goes before the body.

        Parameters
        ----------
        etags
            ETag of each path as it was read last.
        """
        quoted = self.if_match or etags.get(self.matches or "")
        found = {"Content-Type": None if self.body is None else "application/json", "Idempotency-Key": self.key}
        return {name: value for name, value in {**found, "If-Match": quoted}.items() if value is not None}

    def answered(self, content: bytes) -> T_co:
        """The answer's content as its type; raises `AnswerInvalid`."""
        if self.answer in (bytes, str, type(None)):
            return _plain(self.answer, content)
        try:
            return TypeAdapter(self.answer).validate_json(content)
        except ValidationError as error:
            raise AnswerInvalid(self.method, self.path, error) from error


def _plain(kind: type[T], content: bytes) -> T:
    value = content if kind is bytes else content.decode() if kind is str else None
    assert isinstance(value, kind)
    return value


def query(*pairs: tuple[str, object]) -> tuple[tuple[str, str], ...]:
    """The parameters that have a value, as text."""
    return tuple((name, _text(value)) for name, value in pairs if value is not None)


def escaped(name: str) -> str:
    """A name as one piece of a path."""
    return quote(name, safe="")


def _text(value: object) -> str:
    return value.isoformat() if isinstance(value, datetime) else str(value)


def new_key() -> str:
    """A key for a new action."""
    return str(uuid.uuid4())
