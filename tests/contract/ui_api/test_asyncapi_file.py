"""The committed AsyncAPI file has a message for every kind of event, and what is sent is as it says."""

import json
from pathlib import Path

from services.ui_api.core.event_data import PlanMade
from services.ui_api.core.events import Event, EventKind
from services.ui_api.routes.views import EventView
from tools.asyncapi import asyncapi_document, asyncapi_text

_FILE = Path(__file__).parents[3] / "docs" / "asyncapi.json"
_MADE = PlanMade(1, 2, ("distal",), "a" * 64, "b" * 64, 1)


def _references(value: object) -> list[str]:
    if isinstance(value, dict):
        own = [value["$ref"]] if isinstance(value.get("$ref"), str) else []
        return own + [one for inner in value.values() for one in _references(inner)]
    return [one for inner in value for one in _references(inner)] if isinstance(value, list) else []


def test_the_committed_file_is_up_to_date() -> None:
    assert _FILE.read_text(encoding="utf-8") == asyncapi_text(), "run make generated"


def test_every_kind_of_event_has_its_message() -> None:
    channels = json.loads(asyncapi_text())["channels"]
    assert (
        set(channels["events"]["messages"]) == set(channels["case_events"]["messages"]) == {str(k) for k in EventKind}
    )


def test_every_reference_leads_somewhere() -> None:
    document = asyncapi_document()
    found = _references(document)
    assert len(found) > 50
    for reference in found:
        place: object = document
        for step in reference.removeprefix("#/").split("/"):
            assert isinstance(place, dict), reference
            assert step in place, reference
            place = place[step]


def test_an_event_has_the_members_that_its_message_names() -> None:
    document = json.loads(asyncapi_text())
    sent = json.loads(EventView.json_of(Event(7, 8, "case-1", "demo", "", _MADE)))
    message = document["components"]["messages"][sent["kind"]]
    assert set(sent) == set(message["payload"]["properties"]) == set(message["payload"]["required"])
    schema = document["components"]["schemas"]["PlanMade"]
    assert set(sent["data"]) == set(schema["properties"])
