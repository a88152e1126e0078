"""`docs/tuning.md` is printed from the declarations; every value is read by some module, with a provenance."""

import importlib
import re
from pathlib import Path

import pytest

from tools.tuning_page import MODULES, tuned_values, tuning_page

_ROOT = Path(__file__).parents[3]
_PAGE = _ROOT / "docs" / "tuning.md"
_READ = {
    name
    for folder in ("services", "shared", "distalock")
    for file in (_ROOT / folder).rglob("*.py")
    if file.name != "tuning.py"
    for name in re.findall(r"\.(\w+)", file.read_text(encoding="utf-8"))
}


def test_the_page_is_up_to_date() -> None:
    assert _PAGE.read_text(encoding="utf-8") == tuning_page(), "run: make generated"


@pytest.mark.parametrize("module", MODULES)
def test_every_value_has_a_unit_an_effect_and_an_origin(module: str) -> None:
    values = tuple(tuned_values(importlib.import_module(module)))
    assert values
    assert [value.name for value in values if not (value.unit and value.effect and value.origin.source)] == []


@pytest.mark.parametrize("module", MODULES)
def test_every_value_is_read_somewhere(module: str) -> None:
    values = tuned_values(importlib.import_module(module))
    assert [f"{value.group}.{value.name}" for value in values if value.name not in _READ] == []
