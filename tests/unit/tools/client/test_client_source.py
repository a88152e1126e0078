"""What the client's generator makes of small documents."""

import pytest

from tools.client.calls import calls_source, methods_source
from tools.client.models import event_models_source, models_source
from tools.client.operations import operations_of
from tools.client.types import JsonObject, python_type


@pytest.mark.parametrize(
    ("schema", "sent", "received"),
    [
        ({"type": "string"}, "str", "str"),
        ({"type": "string", "format": "date-time"}, "datetime", "datetime"),
        ({"type": "array", "items": {"type": "integer"}}, "Sequence[int]", "tuple[int, ...]"),
        ({"anyOf": [{"type": "number"}, {"type": "null"}]}, "float | None", "float | None"),
        ({"enum": ["a", "b"], "type": "string"}, "Literal['a', 'b']", "Literal['a', 'b']"),
        ({"const": "x"}, "Literal['x']", "Literal['x']"),
        ({"type": "array", "prefixItems": [{"type": "number"}] * 2}, "tuple[float, float]", "tuple[float, float]"),
        ({"type": "object", "additionalProperties": True}, "Mapping[str, object]", "dict[str, object]"),
        ({"$ref": "#/components/schemas/Page_CaseView_"}, "Page[CaseView]", "Page[CaseView]"),
        ({}, "object", "object"),
    ],
)
def test_types(schema: JsonObject, sent: str, received: str) -> None:
    assert (python_type(schema, sent=True), python_type(schema, sent=False)) == (sent, received)


BODY: JsonObject = {
    "type": "object",
    "required": ["name"],
    "properties": {
        "name": {"type": "string"},
        "password": {"type": "string", "format": "password"},
        "said_by": {"type": "string", "deprecated": True},
        "schema": {"type": "string", "default": "x/1"},
    },
}
VIEW: JsonObject = {"type": "object", "required": ["names"], "properties": {"names": {"type": "array", "items": {}}}}
DOCUMENT: JsonObject = {
    "components": {"schemas": {"ThingBody": BODY, "ThingView": VIEW, "Page_ThingView_": {}}},
    "paths": {
        "/things/{name}/parts": {
            "post": {
                "operationId": "add_part",
                "description": "Add a part.",
                "x-distalock-if-match": "/things/{name}",
                "parameters": [
                    {"in": "path", "name": "name", "required": True, "schema": {"type": "string"}},
                    {"in": "header", "name": "If-Match", "required": True, "schema": {"type": "string"}},
                    {"in": "header", "name": "Idempotency-Key", "required": True, "schema": {"type": "string"}},
                ],
                "requestBody": {
                    "content": {"application/json": {"schema": {"$ref": "#/components/schemas/ThingBody"}}}
                },
                "responses": {"201": {"content": {"application/json": {"schema": {"$ref": "#/x/ThingView"}}}}},
            },
            "get": {
                "operationId": "list_parts",
                "description": "The parts.",
                "parameters": [
                    {"in": "path", "name": "name", "required": True, "schema": {"type": "string"}},
                    {"in": "query", "name": "cursor", "required": False, "schema": {"type": "string"}},
                    {"in": "query", "name": "fields", "required": False, "schema": {"type": "string"}},
                ],
                "responses": {"200": {"content": {"application/json": {"schema": {"$ref": "#/x/Page_ThingView_"}}}}},
            },
        },
        "/stream": {
            "get": {
                "operationId": "stream",
                "description": "Events.",
                "responses": {"200": {"content": {"text/event-stream": {}}}},
            }
        },
    },
}


def test_models_are_of_what_is_sent_or_received() -> None:
    source = models_source(DOCUMENT)
    assert "class ThingBody(SentModel):" in source
    assert "class ThingView(ReceivedModel):" in source
    assert "password: str | None = Field(default=None, repr=False)" in source
    assert "schema_name: str = Field(default='x/1', alias='schema')" in source
    assert "said_by" not in source, "what is deprecated is not offered"
    assert "Page_" not in source


def test_calls_quote_and_carry_keys() -> None:
    adding, listing = operations_of(DOCUMENT)
    source = calls_source([adding, listing])
    assert "def add_part(name: str, body: ThingBody, *, if_match: str | None = None, idempotency_key" in source
    assert 'f"/things/{escaped(name)}/parts"' in source
    assert 'matches=f"/things/{escaped(name)}"' in source
    assert "-> Call[Page[ThingView]]" in source
    assert "fields" not in source


@pytest.mark.parametrize(
    ("is_async", "walks"), [(False, "-> Iterator[ThingView]"), (True, "-> AsyncIterator[ThingView]")]
)
def test_a_list_can_be_walked(*, is_async: bool, walks: str) -> None:
    source = methods_source(list(operations_of(DOCUMENT)), is_async=is_async)
    assert f"def iterate_parts(self, name: str) {walks}" in source
    assert ("await self.send" in source) is is_async


def test_events_name_their_data() -> None:
    made: JsonObject = {"payload": {"properties": {"data": {"$ref": "#/x/Made"}}}, "name": "made"}
    document: JsonObject = {
        "components": {
            "messages": {"made": made, "picture": {}},
            "schemas": {"Made": {"type": "object", "properties": {"reason": {"$ref": "#/x/Known"}}}, "Known": {}},
        }
    }
    source = event_models_source(document, ["Known"])
    assert "from distalock.client.models import Known" in source
    assert "class Made(ReceivedModel)" in source
    assert "'made': Made," in source
