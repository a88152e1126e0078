"""Today's services beside those of the last release, message by message: what either says, the other must read.

`releases/VERSION` keeps the schemas of a release (`make version`), those of the part files that travel in messages as
well. A message that changed otherwise than by these rules takes a new number, and the old one stays.

A reason for a refusal may have a code that the last release does not know: its readers refuse that message, which is a
refusal already (`test_messages.py`), while a room is upgraded and no case is open.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import pytest

from shared.messages.schema_files import SCHEMAS
from tools.version import PART_SCHEMAS

Schema = Mapping[str, object]
RELEASES: Final = sorted(Path(__file__).with_name("releases").iterdir())
# Part files with a field that a reader of the last release does not know. The gateway sends part files, and is upgraded
# last (docs/releases.md); a message of any other service may have no such field.
LATER_FIELDS: Final = {"nail-1": [".bone is not known"]}
# Of enumerations that may grow, as `unread` names their new values.
GROWING: Final = ("ReasonCode may be ",)


def schemas_of(folder: Path) -> dict[str, Schema]:
    return {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in folder.glob("*.json")}


def todays() -> dict[str, Schema]:
    return schemas_of(SCHEMAS) | schemas_of(PART_SCHEMAS)


def objects(schema: Schema) -> Iterator[tuple[str, Schema]]:
    """The message and the objects that it is made of, by name."""
    yield "", schema
    definitions = schema.get("$defs", {})
    assert isinstance(definitions, dict)
    yield from definitions.items()


def unread(said: Schema, reader: Schema) -> list[str]:
    """What one version of a message may say, and the reader of another version refuses."""
    known = dict(objects(reader))
    found = []
    for name, one in objects(said):
        other = known.get(name)
        if other is None:
            continue  # named from a field, which is compared
        found += [f"{name}.{field} is not known" for field in sorted(_fields(one) - _fields(other))]
        found += [f"{name}.{field} is missing" for field in sorted(_required(other) - _fields(one))]
        found += [f"{name} may be {value}" for value in sorted(_values(one) - _values(other))]
    return found


def _fields(schema: Schema) -> set[str]:
    properties = schema.get("properties", {})
    assert isinstance(properties, dict)
    return set(properties)


def _required(schema: Schema) -> set[str]:
    required = schema.get("required", [])
    assert isinstance(required, list)
    return set(required)


def _values(schema: Schema) -> set[str]:
    values = schema.get("enum", [])
    assert isinstance(values, list)
    return {str(value) for value in values}


PAIRS: Final = [(release, name) for release in RELEASES for name in sorted(schemas_of(release))]


@pytest.mark.parametrize(("release", "name"), PAIRS, ids=lambda one: one if isinstance(one, str) else one.name)
def test_today_reads_what_a_release_says(release: Path, name: str) -> None:
    now = todays()
    assert name in now, f"{name} is on wires and disks of {release.name}: its decoder stays"
    assert unread(schemas_of(release)[name], now[name]) == []


@pytest.mark.parametrize("name", sorted(schemas_of(RELEASES[-1])))
def test_the_last_release_reads_what_today_says(name: str) -> None:
    found = unread(todays()[name], schemas_of(RELEASES[-1])[name])
    missing = [one for one in found if not one.startswith(GROWING)]
    assert missing == LATER_FIELDS.get(name, [])


def test_fields_are_new_in_part_files_alone() -> None:
    assert set(LATER_FIELDS) <= set(schemas_of(PART_SCHEMAS))


def test_a_code_of_a_reason_may_be_new() -> None:
    old: Schema = {"$defs": {"ReasonCode": {"enum": ["saturated"]}, "Verdict": {"enum": ["accepted"]}}}
    new: Schema = {"$defs": {"ReasonCode": {"enum": ["saturated", "dim"]}, "Verdict": {"enum": ["accepted", "half"]}}}
    found = unread(new, old)
    assert found == ["ReasonCode may be dim", "Verdict may be half"]
    assert [one for one in found if not one.startswith(GROWING)] == ["Verdict may be half"]


def test_a_release_keeps_the_schemas_of_part_files_too() -> None:
    for release in RELEASES:
        assert set(schemas_of(PART_SCHEMAS)) <= set(schemas_of(release))


def test_differences_are_found() -> None:
    old: Schema = {"properties": {"a": {}, "b": {}}, "required": ["a"], "$defs": {"State": {"enum": ["on", "off"]}}}
    new: Schema = {
        "properties": {"a": {}, "c": {}},
        "required": ["a", "c"],
        "$defs": {"State": {"enum": ["on", "half"]}},
    }
    assert unread(new, old) == [".c is not known", "State may be half"]
    assert unread(old, new) == [".b is not known", ".c is missing", "State may be off"]
