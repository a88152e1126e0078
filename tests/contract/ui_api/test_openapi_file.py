"""The committed OpenAPI file is what the gateway serves."""

import json
import re
from pathlib import Path

import pytest

from services.ui_api.app import openapi_document, routed_app

_FILE = Path(__file__).parents[3] / "docs" / "openapi.json"
_ACTING = ("post", "put", "patch", "delete")

JsonObject = dict[str, object]


@pytest.fixture(scope="module")
def document() -> JsonObject:
    return json.loads(json.dumps(openapi_document(routed_app())))  # type: ignore[no-any-return]


def _operations(document: JsonObject) -> list[tuple[str, str, JsonObject]]:
    paths = document["paths"]
    assert isinstance(paths, dict)
    return [(path, verb, operation) for path, verbs in paths.items() for verb, operation in verbs.items()]


def test_the_committed_file_is_up_to_date(document: JsonObject) -> None:
    committed = json.loads(_FILE.read_text(encoding="utf-8"))
    assert committed == document, "run: python -m services.ui_api openapi > docs/openapi.json"


def test_every_operation_may_answer_with_a_problem(document: JsonObject) -> None:
    for path, verb, operation in _operations(document):
        responses = operation["responses"]
        assert isinstance(responses, dict)
        assert "application/problem+json" in responses["default"]["content"], f"{verb} {path}"
        assert "422" not in responses, f"{verb} {path} documents FastAPI's own error instead of a problem"


def test_every_post_but_stop_and_those_without_a_login_needs_an_idempotency_key(document: JsonObject) -> None:
    without = []
    for path, verb, operation in _operations(document):
        parameters = operation.get("parameters", [])
        assert isinstance(parameters, list)
        required = {p["name"] for p in parameters if p["required"]}
        if verb == "post" and "Idempotency-Key" not in required:
            without.append(path)
    once_anyway = [f"/api/v1/users/me/passkeys{rest}" for rest in ("", "/challenge", "/registration")]
    assert set(without) == {
        "/api/v1/robot/stop",
        "/api/v1/sessions",
        "/api/v1/sessions/refresh",
        "/api/v1/setup",
        *once_anyway,
    }


def test_bodies_refuse_unknown_keys(document: JsonObject) -> None:
    components = document["components"]
    assert isinstance(components, dict)
    for path, verb, operation in _operations(document):
        if verb in _ACTING and "requestBody" in operation:
            reference = re.search(r"#/components/schemas/(\w+)", json.dumps(operation["requestBody"]))
            schema = components["schemas"][reference.group(1)] if reference else _form(operation)
            assert schema["additionalProperties"] is False, f"{verb} {path}"


def _form(operation: JsonObject) -> JsonObject:
    """The schema of a form, which is written where it is used."""
    body = operation["requestBody"]
    assert isinstance(body, dict)
    schema = body["content"]["application/x-www-form-urlencoded"]["schema"]
    assert isinstance(schema, dict)
    return schema
