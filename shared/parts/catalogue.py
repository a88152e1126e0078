"""The parts that the product ships, by name: the folder `catalogue` beside this module."""

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final, Literal, get_args

PartKind = Literal["ring", "guide", "nail", "hexapod"]
PART_KINDS: tuple[PartKind, ...] = get_args(PartKind)
FOLDER: Final = Path(__file__).with_name("catalogue")
DEFAULT_HEXAPOD: Final = FOLDER / "hexapod-h70.json"


@dataclass(frozen=True, slots=True)
class CatalogueEntry:
    """One part of the catalogue: the name and the content of its file."""

    name: str
    kind: PartKind
    content: bytes


@cache
def catalogue() -> tuple[CatalogueEntry, ...]:
    """All parts, sorted by name."""
    contents = {file.stem: file.read_bytes() for file in FOLDER.glob("*.json")}
    kinds = {name: kind_of(content) for name, content in contents.items()}
    return tuple(CatalogueEntry(name, kind, contents[name]) for name, kind in sorted(kinds.items()) if kind is not None)


def catalogue_names(kind: PartKind) -> tuple[str, ...]:
    """Names of the parts of a kind, sorted."""
    return tuple(entry.name for entry in catalogue() if entry.kind == kind)


def catalogue_entry(name: str) -> CatalogueEntry | None:
    """The part of that name; None when there is none."""
    return next((entry for entry in catalogue() if entry.name == name), None)


def kind_of(content: bytes) -> PartKind | None:
    """The kind that a JSON file's `schema` names; None when it is no part."""
    schema = schema_of(content)
    return next((kind for kind in PART_KINDS if schema == f"distalock/{kind}/1"), None)


def schema_of(content: bytes) -> object:
    """The value of `schema` in a JSON object; None when there is none."""
    parsed = json.loads(content)
    return parsed.get("schema") if isinstance(parsed, dict) else None
