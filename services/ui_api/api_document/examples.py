"""Examples of bodies and answers, recorded from a simulation by `make examples`."""

import json
from pathlib import Path
from typing import Final

from services.ui_api.api_document.operations import JsonObject, Operation, operations

EXAMPLES: Final = Path(__file__).with_name("examples.json")
_NAME: Final = "recorded"


def add_examples(document: JsonObject) -> None:
    """Give every operation what was sent and answered when a case was recorded."""
    recorded = json.loads(EXAMPLES.read_text(encoding="utf-8")) if EXAMPLES.exists() else {}
    components = document["components"]
    assert isinstance(components, dict)
    kept: JsonObject = {}
    for operation in operations(document):
        _add(operation, recorded.get(operation.name, {}), kept)
    if "problem" in recorded:
        kept["problem"] = {"summary": "Somebody was faster.", "value": recorded["problem"]["answer"]}
        for operation in operations(document):
            _media(operation.answer("default"))["examples"] = _reference("problem")
    components["examples"] = kept


def _add(operation: Operation, example: JsonObject, kept: JsonObject) -> None:
    """The values go among the document's examples, and the operation refers to them."""
    path = example.get("path", {})
    assert isinstance(path, dict)
    for name, value in path.items():
        parameter = operation.parameter("path", name)
        assert parameter is not None
        schema = parameter["schema"]
        assert isinstance(schema, dict)
        parameter["example"] = int(value) if schema["type"] == "integer" else value
    if "body" in example:
        kept[f"{operation.name}_body"] = {"value": example["body"]}
        _media(operation.described["requestBody"])["examples"] = _reference(f"{operation.name}_body")
    if "answer" in example:
        kept[operation.name] = {"value": example["answer"]}
        _media(next(iter(operation.good_answers.values())))["examples"] = _reference(operation.name)


def _media(described: object) -> JsonObject:
    """The only kind of content that a body or an answer has."""
    assert isinstance(described, dict)
    media = next(iter(described["content"].values()))
    assert isinstance(media, dict)
    return media


def _reference(name: str) -> JsonObject:
    return {_NAME: {"$ref": f"#/components/examples/{name}"}}
