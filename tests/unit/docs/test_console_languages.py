"""The console says in each of its languages what the gateway says about the procedure."""

import json
from pathlib import Path

import pytest

from services.ui_api.core.next_step import NEXT
from services.ui_api.core.procedure import Stage
from services.ui_api.core.procedure_table import TABLE

_LANGUAGES = Path(__file__).parents[3] / "services/ui_api/console/src/languages"
# Only a value.
_BARE = "{operation}"


def _said() -> set[str]:
    conditions = [condition for row in TABLE.values() for condition in row.conditions]
    sentences = {row.sentence for row in NEXT} | {text for c in conditions for text in (c.observed, c.remedy)}
    return (sentences | set(Stage)) - {_BARE}


@pytest.mark.parametrize("language", ["de", "zh"])
def test_every_sentence_of_the_procedure_is_translated(language: str) -> None:
    known = json.loads((_LANGUAGES / f"gateway.{language}.json").read_text(encoding="utf-8"))
    assert _said() - set(known) == set()
    # What is left are values that sentences quote: a side, or holes.
    assert all(" " not in other or "," in other for other in set(known) - _said())
