"""Cursor pages: a cursor is opaque to clients and stays valid, because lists only ever grow at their end.

The list of images may also lose older ones; a cursor counts them, so that after it an image may come again, and none is
left out.
"""

import base64
import itertools
import re
from collections.abc import Callable, Sequence
from datetime import datetime
from typing import Annotated, Final, Generic, Literal, TypeVar

from fastapi import Query
from pydantic import AwareDatetime, BaseModel, StringConstraints, WithJsonSchema

from services.ui_api.handlers.refusals import RefusalKind, Refused

T = TypeVar("T")
V = TypeVar("V")

Limit = Annotated[int, Query(ge=1, le=200)]
_MARK = "after:"
# Beyond every list, and within the 64 bits of the databases.
_MOST_PLACES: Final = 10**18
# What `cursor_after` makes: the mark and a number, in base64.
_CURSOR_PATTERN: Final = "^YWZ0ZXI6[A-Za-z0-9_-]{1,32}$"
Cursor = Annotated[
    Annotated[str, WithJsonSchema({"type": "string", "pattern": _CURSOR_PATTERN})] | None,
    Query(description="`next_cursor` of the page before."),
]

SortName = Literal["oldest", "newest"]
Sort = Annotated[SortName, Query(description="Which come first.")]
Since = Annotated[AwareDatetime | None, Query(description="Only what is of this time or later (RFC 3339).")]
VerdictFilter = Annotated[Literal["accepted", "rejected"] | None, Query(description="Only those with this verdict.")]
HoleFilter = Annotated[
    Annotated[str, StringConstraints(min_length=1, max_length=64)] | None, Query(description="Only those of this hole.")
]


def is_since(at_ns: int, since: datetime | None) -> bool:
    """Whether a time is not before another; of everything, without one."""
    return since is None or at_ns >= since.timestamp() * 1e9


class Page(BaseModel, Generic[V]):
    """One page of a list, the oldest first unless asked otherwise; `next_cursor` is null on the last."""

    items: list[V]
    next_cursor: str | None


def page(
    entries: Sequence[T],
    cursor: str | None,
    limit: int,
    view: Callable[[T], V],
    lost: int = 0,
    *,
    wanted: Callable[[T], bool] | None = None,
    sort: SortName = "oldest",
) -> Page[V]:
    """One page of a list, which has lost so many older entries; of those that are wanted.

    A cursor is a place in the whole list: what later begins or ceases to be wanted shifts nothing.

    Raises
    ------
    Refused
        When the cursor is none that this gateway gave out.
    """
    if sort == "oldest":
        places = range(max(position_of(cursor) - lost, 0), len(entries))
    else:
        newest = len(entries) if cursor is None else min(max(position_of(cursor) - lost, 0), len(entries))
        places = range(newest - 1, -1, -1)
    found = (place for place in places if wanted is None or wanted(entries[place]))
    shown = list(itertools.islice(found, limit))
    items = [view(entries[place]) for place in shown]
    if next(found, None) is None:
        return Page(items=items, next_cursor=None)
    return Page(items=items, next_cursor=cursor_after(shown[-1] + lost + (1 if sort == "oldest" else 0)))


def cursor_after(position: int) -> str:
    """The cursor of a place in a list."""
    return base64.urlsafe_b64encode(f"{_MARK}{position}".encode()).decode().rstrip("=")


def position_of(cursor: str | None) -> int:
    """The place that a cursor names, and the beginning without one; raises `Refused`."""
    return 0 if cursor is None else _position(cursor)


def _position(cursor: str) -> int:
    if re.fullmatch(_CURSOR_PATTERN, cursor) is None:
        return _refuse()
    try:
        text = base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)).decode("ascii")
    except ValueError:  # what is not base64, and what is not ASCII: both are kinds of it
        return _refuse()
    number = text.removeprefix(_MARK)
    is_place = number.isascii() and number.isdigit() and int(number) < _MOST_PLACES
    return int(number) if is_place else _refuse()


def _refuse() -> int:
    raise Refused(
        RefusalKind.MALFORMED, "cursor_invalid", "the cursor is none that was given out; begin without a cursor"
    )
