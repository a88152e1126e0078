"""One hash of each part, however its file is written."""

import json

import pytest

from shared.errors import PartFileInvalid
from shared.parts.canonical import canonical_part, catalogue_sha256, part_sha256
from shared.parts.catalogue import PartKind, catalogue, catalogue_entry
from shared.parts.files import guide_from_json, nail_from_json, ring_from_json, sha256_of
from shared.parts.hexapod_file import hexapod_from_json


def read_hash(kind: PartKind, content: bytes) -> str:
    """The hash that the part has for who reads its file."""
    match kind:
        case "ring":
            return ring_from_json(content).sha256
        case "guide":
            return guide_from_json(content).sha256
        case "nail":
            return nail_from_json(content).sha256
        case "hexapod":
            return hexapod_from_json(content).sha256


def written_otherwise(content: bytes) -> bytes:
    """The same part: keys the other way round, other spaces, whole numbers without a point."""

    def turned(value: object) -> object:
        match value:
            case dict():
                return {key: turned(one) for key, one in reversed(value.items())}
            case list():
                return [turned(one) for one in value]
            case float() if value.is_integer():
                return int(value)
            case _:
                return value

    return json.dumps(turned(json.loads(content)), indent=3).encode()


@pytest.mark.parametrize("entry", catalogue(), ids=lambda entry: entry.name)
def test_a_part_has_one_hash_whoever_reads_it_and_however_it_is_written(entry) -> None:  # type: ignore[no-untyped-def]
    sha256 = catalogue_sha256(entry)
    other = written_otherwise(entry.content)
    assert read_hash(entry.kind, entry.content) == sha256
    assert read_hash(entry.kind, other) == sha256
    text = canonical_part(other, "file")
    assert sha256_of(text) == sha256
    assert canonical_part(text, "file") == text
    assert read_hash(entry.kind, text) == sha256


def test_the_hash_of_a_part_stays_what_it_is() -> None:
    """Cases, approvals and permits name parts by it: a schema's new field must be absent where a file has it not."""
    nail = {
        "schema": "distalock/nail/1",
        "units": "mm",
        "material": "steel",
        "diameter_mm": 11,
        "cannulation_diameter_mm": 5,
        "tip_x_mm": 30,
        "holes": [{"id": "distal", "position_mm": [15, 0, 0], "direction": [0, 0, 1], "diameter_mm": 5}],
    }
    text = canonical_part(json.dumps(nail).encode(), "nail")
    assert text == (
        b'{"schema":"distalock/nail/1","units":"mm","material":"steel","diameter_mm":11.0,'
        b'"cannulation_diameter_mm":5.0,"tip_x_mm":30.0,"holes":[{"id":"distal","direction":[0.0,0.0,1.0],'
        b'"diameter_mm":5.0,"position_mm":[15.0,0.0,0.0]}]}'
    )


def test_another_figure_is_another_part() -> None:
    entry = catalogue_entry("hexapod-h70")
    assert entry is not None
    taller = json.loads(entry.content)
    taller["zero_height_mm"] += 0.001
    assert part_sha256(json.dumps(taller).encode(), "file") != catalogue_sha256(entry)


def test_what_is_no_part_has_no_hash() -> None:
    with pytest.raises(
        PartFileInvalid, match=r"x\.json: its schema is 'distalock/scenario/1', expected one of distalock"
    ):
        part_sha256(b'{"schema": "distalock/scenario/1"}', "x.json")
