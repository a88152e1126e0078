"""The catalogue: every file in its folder is a part that its own reader takes."""

import json

import pytest

from shared.parts.catalogue import PART_KINDS, PartKind, catalogue, catalogue_entry, catalogue_names, kind_of
from shared.parts.files import guide_from_json, nail_from_json, ring_from_json
from shared.parts.hexapod_file import hexapod_from_json

READERS = {"ring": ring_from_json, "guide": guide_from_json, "nail": nail_from_json, "hexapod": hexapod_from_json}


@pytest.mark.parametrize("entry", catalogue(), ids=lambda entry: entry.name)
def test_every_part_can_be_read(entry) -> None:  # type: ignore[no-untyped-def]
    READERS[entry.kind](entry.content, entry.name)
    assert entry.name.startswith(f"{entry.kind}-")


@pytest.mark.parametrize("kind", PART_KINDS)
def test_there_is_a_part_of_every_kind(kind: PartKind) -> None:
    names = catalogue_names(kind)
    assert names
    assert list(names) == sorted(names)
    assert all((entry := catalogue_entry(name)) is not None and entry.kind == kind for name in names)


def test_there_is_no_part_of_another_name() -> None:
    assert catalogue_entry("nail-of-wood") is None


@pytest.mark.parametrize("content", [{"schema": "distalock/nail/2"}, {}, ["distalock/nail/1"]])
def test_other_json_is_no_part(content: object) -> None:
    assert kind_of(json.dumps(content).encode()) is None
