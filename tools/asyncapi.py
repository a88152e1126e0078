"""`docs/asyncapi.json`: what the gateway sends by itself, as AsyncAPI 3: the log's events, and `WS /live`."""

import json
from inspect import getdoc
from typing import Final

from pydantic import TypeAdapter
from pydantic.json_schema import JsonSchemaMode

from services.ui_api.app import PREFIX, TITLE
from services.ui_api.core.events import DATA_OF_KIND, EventKind
from services.ui_api.routes.live_viewers import LiveView
from services.ui_api.routes.views import EventView

JsonObject = dict[str, object]
_MODE: Final[JsonSchemaMode] = "serialization"
_SCHEMAS: Final = "#/components/schemas/{model}"
_LOG: Final = "The log as server-sent events: `id` is `sequence`, `event` is `kind`. Resumable by Last-Event-ID."


def asyncapi_document() -> JsonObject:
    """The document: a message for each kind of event, with the schema of its data."""
    schemas: JsonObject = {}
    messages = {str(kind): _event_message(kind, schemas) for kind in DATA_OF_KIND}
    live = _schema_of(LiveView, schemas)
    every = {kind: {"$ref": f"#/components/messages/{kind}"} for kind in messages}
    case_id = {"case_id": {"description": "Id of the case."}}
    return {
        "asyncapi": "3.0.0",
        "info": {"title": TITLE, "version": "1", "description": "What docs/rest.md describes under Events."},
        "channels": {
            "events": {"address": f"{PREFIX}/events", "description": _LOG, "messages": every},
            "case_events": {
                "address": f"{PREFIX}/cases/{{case_id}}/events",
                "description": _LOG,
                "parameters": case_id,
                "messages": every,
            },
            "live": {
                "address": f"{PREFIX}/live",
                "description": "WebSocket: a text message for each image or guidance that the viewer keeps up with; "
                "when its `picture` is not null, the picture follows as a binary message.",
                "messages": {"live": {"$ref": "#/components/messages/live"}, "picture": {"$ref": _PICTURE}},
            },
        },
        "operations": {
            f"send_{name}": {"action": "send", "channel": {"$ref": f"#/channels/{name}"}}
            for name in ("events", "case_events", "live")
        },
        "components": {
            "messages": {
                **messages,
                "live": {"contentType": "application/json", "payload": live},
                "picture": {"contentType": "image/jpeg", "payload": {"type": "string", "format": "binary"}},
            },
            "schemas": dict(sorted(schemas.items())),
        },
    }


_PICTURE: Final = "#/components/messages/picture"


def asyncapi_text() -> str:
    """The file's content."""
    return json.dumps(asyncapi_document(), indent=1, ensure_ascii=False) + "\n"


def _event_message(kind: EventKind, schemas: JsonObject) -> JsonObject:
    data = DATA_OF_KIND[kind]
    says = (getdoc(data) or "").partition("\n\n")[0].replace("\n", " ")
    content = _schema_of(data, schemas)
    event = EventView.model_json_schema(mode=_MODE)
    properties = {**event["properties"], "kind": {"const": str(kind)}, "data": content}
    payload = {"type": "object", "properties": properties, "required": event["required"]}
    return {"name": str(kind), "summary": says, "contentType": "application/json", "payload": payload}


def _schema_of(kind: type, schemas: JsonObject) -> JsonObject:
    """A reference to a type's schema, which is put among the others with all that it refers to."""
    found = TypeAdapter(kind).json_schema(mode=_MODE, ref_template=_SCHEMAS, by_alias=True)
    schemas |= found.pop("$defs", {})
    schemas[kind.__name__] = found
    return {"$ref": _SCHEMAS.format(model=kind.__name__)}
