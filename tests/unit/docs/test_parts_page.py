"""`docs/parts.md` describes every field of the part files, and no other."""

import json
import re
from pathlib import Path

import pytest

from tools.part_schemas import part_schema_texts

_PAGE = (Path(__file__).parents[3] / "docs" / "parts.md").read_text(encoding="utf-8")
_SCHEMAS = [json.loads(text) for text in part_schema_texts().values()]


def _fields(schema: dict[str, dict[str, object]]) -> set[str]:
    found = set(schema["properties"])
    for definition in schema.get("$defs", {}).values():
        assert isinstance(definition, dict)
        found |= set(definition.get("properties", {}))
    return found


@pytest.mark.parametrize("schema", _SCHEMAS, ids=[str(schema["title"]) for schema in _SCHEMAS])
def test_every_field_is_described(schema: dict[str, dict[str, object]]) -> None:
    tables = "".join(line for line in _PAGE.splitlines() if line.startswith("|"))
    assert _fields(schema) - set(re.findall(r"`(\w+)`", tables)) == set()


def test_every_row_belongs_to_a_field() -> None:
    known = set().union(*map(_fields, _SCHEMAS))
    rows = re.findall(r"^\| ((?:`\w+`(?:, )?)+) \|", _PAGE, re.MULTILINE)
    assert {name for row in rows for name in re.findall(r"`(\w+)`", row)} <= known
