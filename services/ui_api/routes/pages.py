"""Cursor pages: a cursor is opaque to clients and stays valid, because lists only ever grow at their end.

The list of images may also lose older ones; a cursor counts them, so that after it an image may come again, and none is
left out.
"""

import base64
import re
from collections.abc import Callable, Sequence
from typing import Annotated, Final, Generic, TypeVar

from fastapi import Query
from pydantic import BaseModel, WithJsonSchema

from services.ui_api.handlers.refusals import RefusalKind, Refused

T = TypeVar("T")
V = TypeVar("V")

Limit = Annotated[int, Query(ge=1, le=200)]
_MARK = "after:"
# What `_cursor` makes: the mark and a number, in base64.
_CURSOR_PATTERN: Final = "^YWZ0ZXI6[A-Za-z0-9_-]{1,32}$"
Cursor = Annotated[
    Annotated[str, WithJsonSchema({"type": "string", "pattern": _CURSOR_PATTERN})] | None,
    Query(description="`next_cursor` of the page before."),
]


class Page(BaseModel, Generic[V]):
    """One page of a list, the oldest first; `next_cursor` is null on the last."""

    items: list[V]
    next_cursor: str | None


def page(entries: Sequence[T], cursor: str | None, limit: int, view: Callable[[T], V], lost: int = 0) -> Page[V]:
    """One page of a list, which has lost so many older entries.

    Raises
    ------
    Refused
        When the cursor is none that this gateway gave out.
    """
    start = 0 if cursor is None else max(_position(cursor) - lost, 0)
    end = start + limit
    items = [view(entry) for entry in entries[start:end]]
    return Page(items=items, next_cursor=_cursor(end + lost) if end < len(entries) else None)


def _cursor(position: int) -> str:
    return base64.urlsafe_b64encode(f"{_MARK}{position}".encode()).decode().rstrip("=")


def _position(cursor: str) -> int:
    if re.fullmatch(_CURSOR_PATTERN, cursor) is None:
        return _refuse()
    try:
        text = base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)).decode("ascii")
    except ValueError:  # what is not base64, and what is not ASCII: both are kinds of it
        return _refuse()
    number = text.removeprefix(_MARK)
    return int(number) if number.isascii() and number.isdigit() else _refuse()


def _refuse() -> int:
    raise Refused(
        RefusalKind.MALFORMED, "cursor_invalid", "the cursor is none that was given out; begin without a cursor"
    )
