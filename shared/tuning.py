"""Declare tuned values: each with its unit, its effect, and where the number comes from.

A service's `tuning.py` groups them in frozen dataclasses, one instance each; code reads them by name at the call::

    @dataclass(frozen=True, slots=True)
    class BandSearch:
        step_mm: float = tuned(0.5, "mm", "spacing of the lines on which edges are sought", derived("half a cortex"))

    BAND_SEARCH = BandSearch()

`docs/tuning.md` is printed from these declarations, and `distalock bench sensitivity` varies each of them.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from enum import StrEnum
from typing import Any, TypeVar, cast

T = TypeVar("T")
_METADATA = "tuned"


class Provenance(StrEnum):
    """Where a number comes from."""

    DERIVED = "derived"
    PHYSICAL = "physical"
    STANDARD = "standard"
    FITTED = "fitted"


@dataclass(frozen=True, slots=True)
class Origin:
    """Provenance of a value, with what it was derived from, its source, the standard, or the data and the command."""

    provenance: Provenance
    source: str


@dataclass(frozen=True, slots=True)
class TunedValue:
    """One declared value, as the table shows it.

    Attributes
    ----------
    group, name
        Dataclass and field that declare it.
    unit
        "1" for ratios and counts.
    effect
        What it does, in one clause.
    """

    group: str
    name: str
    value: object
    unit: str
    effect: str
    origin: Origin


def derived(source: str) -> Origin:
    """Worked out from something else, which `source` names."""
    return Origin(Provenance.DERIVED, source)


def physical(source: str) -> Origin:
    """A property of materials, devices or anatomy, with its source."""
    return Origin(Provenance.PHYSICAL, source)


def standard(source: str) -> Origin:
    """Customary in the field or laid down by a standard, which `source` names."""
    return Origin(Provenance.STANDARD, source)


def fitted(source: str) -> Origin:
    """Chosen on data, which `source` names with the command that measured it."""
    return Origin(Provenance.FITTED, source)


def tuned(value: T, unit: str, effect: str, origin: Origin) -> T:
    """Declare a field of a frozen dataclass with its default, unit, effect and provenance."""
    return field(default=value, metadata={_METADATA: (unit, effect, origin)})


def values_of(group: object) -> tuple[TunedValue, ...]:
    """All tuned values of one settings instance, in the order of their declaration.

    Raises
    ------
    TypeError
        When a field was declared without `tuned`.
    """
    found = []
    for one in fields(cast("Any", group)):
        if _METADATA not in one.metadata:
            raise TypeError(f"{type(group).__name__}.{one.name} has no provenance; declare it with `tuned`")
        unit, effect, origin = one.metadata[_METADATA]
        found.append(TunedValue(type(group).__name__, one.name, getattr(group, one.name), unit, effect, origin))
    return tuple(found)


def declared_groups(namespace: Mapping[str, object]) -> tuple[object, ...]:
    """The settings instances of a `tuning.py`, in the order of their declaration; `namespace` is its `globals()`."""
    public = [value for name, value in namespace.items() if name.isupper() and not name.startswith("_")]
    return tuple(value for value in public if is_dataclass(value) and not isinstance(value, type))


@contextmanager
def overridden(group: object, values: Mapping[str, object]) -> Iterator[None]:
    """Let a settings instance have other values for a while: for sensitivity analyses in a process of their own."""
    before = {name: getattr(group, name) for name in values}
    try:
        for name, value in values.items():
            object.__setattr__(group, name, value)
        yield
    finally:
        for name, value in before.items():
            object.__setattr__(group, name, value)
