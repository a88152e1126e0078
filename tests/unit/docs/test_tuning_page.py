"""`docs/tuning.md` is printed from the declarations, and every declared value has a provenance that says something."""

import importlib
from pathlib import Path

import pytest

from tools.tuning_page import tuned_values, tuning_page

_PAGE = Path(__file__).parents[3] / "docs" / "tuning.md"


def test_the_page_is_up_to_date() -> None:
    assert _PAGE.read_text(encoding="utf-8") == tuning_page(), "run: make generated"


@pytest.mark.parametrize("module", ["services.registration.core.tuning"])
def test_every_group_of_a_module_is_listed_in_its_settings(module: str) -> None:
    declared = importlib.import_module(module)
    groups = {name for name, value in vars(declared).items() if name.isupper() and hasattr(value, "__slots__")}
    listed = {name for name in groups if any(getattr(declared, name) is one for one in declared.SETTINGS)}
    assert listed == groups - {name for name in groups if name.startswith("_")}
    assert all(value.unit and value.effect and value.origin.source for value in tuned_values(declared))
