"""`docs/results.md` names every field of what `locate`, `verify` and `align` print and of a plan."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest
from pydantic import BaseModel

from shared.messages.guidance import Guidance
from shared.messages.registration import Fusion, Localisation, Plan, Verification

_PAGE = (Path(__file__).parents[3] / "docs" / "results.md").read_text(encoding="utf-8")
# Explained by their own pages: what an image's reference and a platform's pose consist of.
_ELSEWHERE = {"ImageReference", "PlatformPoseMessage", "ReasonMessage"}


def _fields(kind: type[BaseModel]) -> Iterator[str]:
    for name, field in kind.model_fields.items():
        if name != "schema_name":
            yield name
            for model in _models(field.annotation):
                yield from _fields(model)


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel) and annotation.__name__ not in _ELSEWHERE:
        yield annotation
    for argument in get_args(annotation):
        yield from _models(argument)


@pytest.mark.parametrize("kind", [Localisation, Fusion, Verification, Guidance, Plan])
def test_every_field_has_its_meaning(kind: type[BaseModel]) -> None:
    missing = [name for name in _fields(kind) if re.search(rf"\b{name}\b", _PAGE) is None]
    assert missing == []
