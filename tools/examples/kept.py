"""Which examples a new recording replaces: those whose shape changed, so that a change is read in a few lines."""

from collections.abc import Mapping
from typing import TypeVar

Example = TypeVar("Example")


def with_changed(before: Mapping[str, Example], now: Mapping[str, Example]) -> dict[str, Example]:
    """Examples by name: as before where members and kinds of values are the same, else as recorded now."""
    return {
        name: before[name] if name in before and shape(before[name]) == shape(now[name]) else now[name]
        for name in sorted(now)
    }


def shape(value: object) -> object:
    """Members of objects, and what kinds of values they and lists have; not the values."""
    if isinstance(value, dict):
        return tuple((name, shape(member)) for name, member in sorted(value.items()))
    if isinstance(value, list):
        return frozenset(shape(item) for item in value)
    return "number" if isinstance(value, int | float) and not isinstance(value, bool) else type(value).__name__
