"""Every operation has an example that was recorded, which fits its schema, and links that lead somewhere."""

import itertools
import json
from pathlib import Path
from typing import Final

import pytest
from pydantic import TypeAdapter

from distalock.client import calls, models
from distalock.client.base import Page
from distalock.client.models import Problem
from services.ui_api.api_document.links import LINKS
from tools.client.operations import operations_of
from tools.client.types import JsonObject, mapping, sequence

_DOCUMENT: Final = mapping(
    json.loads((Path(__file__).parents[3] / "docs" / "openapi.json").read_text(encoding="utf-8"))
)
_EXAMPLES: Final = mapping(mapping(_DOCUMENT["components"])["examples"])
_OPERATIONS: Final = {one.name: one for one in operations_of(_DOCUMENT)}
# Text that this very installation has written: its metrics, and a page of pictures.
_TEXTS: Final = {"read_metrics", "read_qa_page"}
# A key in somebody's hand answers these; tests of passkeys have one that is made of software.
_PASSKEYS: Final = {"begin_passkey", "add_passkey", "ask_challenge", "list_passkeys", "remove_passkey"}
_NOT_RECORDED: Final = (
    _TEXTS | _PASSKEYS | {"read_alarms", "read_case_part", "read_drawing", "read_ways", "remove_passkeys_of_user"}
)


def _type(source: str) -> TypeAdapter[object]:
    """The client's type of that name."""
    return TypeAdapter(eval(source, {"Page": Page, **vars(models)}))  # the generator's own words


def _value(name: str) -> bytes:
    return json.dumps(mapping(_EXAMPLES[name])["value"]).encode()


@pytest.mark.parametrize("name", sorted(_OPERATIONS))
def test_bodies_and_answers_have_examples_that_fit(name: str) -> None:
    operation = _OPERATIONS[name]
    if operation.body and operation.body_needed and name not in _NOT_RECORDED:
        _type(operation.body).validate_json(_value(f"{name}_body"))
    if operation.answer not in (None, "bytes") and name not in _NOT_RECORDED:
        _type(str(operation.answer)).validate_json(_value(name))


def test_every_parameter_of_a_path_has_an_example() -> None:
    without = [
        (one["operationId"], parameter["name"])
        for path in mapping(_DOCUMENT["paths"]).values()
        for one in map(mapping, mapping(path).values())
        for parameter in map(mapping, sequence(one.get("parameters", [])))
        if parameter["in"] == "path" and "example" not in parameter and one["operationId"] not in _NOT_RECORDED
    ]
    assert without == []


def test_the_example_of_a_problem_is_one() -> None:
    problem = Problem.model_validate_json(_value("problem"))
    assert problem.code == "case_changed"
    assert problem.current is not None


def test_examples_tell_nothing_of_the_machine_that_recorded_them() -> None:
    text = json.dumps(_EXAMPLES)
    assert "127.0.0.1" not in text
    assert "/tmp" not in text
    assert "/home" not in text


def test_the_procedure_can_be_walked_along_links() -> None:
    """From each step of the procedure a link leads to the next."""
    walked = ("open_case", "list_images", "read_image", "read_localisation")
    then = ("open_case", "make_plan", "approve_plan", "begin_motion", "read_operation")
    links = {(link.source, link.target) for link in LINKS}
    for steps in (walked, then):
        assert set(itertools.pairwise(steps)) <= links


def test_links_take_what_the_answer_has() -> None:
    by_name = {
        str(mapping(one)["operationId"]): mapping(one)
        for path in mapping(_DOCUMENT["paths"]).values()
        for one in mapping(path).values()
    }
    for link in LINKS:
        assert hasattr(calls, link.target) or link.target.endswith("_events"), link.target
        for expression in (*link.parameters.values(), *map(str, link.body.values())):
            _require(expression, by_name[link.source], link.source)


def _require(expression: str, source: JsonObject, name: str) -> None:
    """An expression names a member of the example, a parameter of the path, or a header of the answer."""
    kind, _, place = expression.partition("#")
    if kind == "$response.body":
        found: object = mapping(_EXAMPLES[name])["value"]
        for step in place.strip("/").split("/"):
            found = sequence(found)[int(step)] if step.isdigit() else mapping(found)[step]
    elif expression.startswith("$request.path."):
        named = [mapping(one)["name"] for one in sequence(source["parameters"])]
        assert expression.removeprefix("$request.path.") in named, (name, expression)
    elif expression.startswith("$response.header."):
        answers = [mapping(one) for status, one in mapping(source["responses"]).items() if status.startswith("2")]
        assert expression.removeprefix("$response.header.") in mapping(answers[0]["headers"]), (name, expression)
