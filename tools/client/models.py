"""Source of the client's models: what is sent, what is answered, and what events carry."""

import json
from collections.abc import Iterable, Mapping
from typing import Final

from tools.client.types import JsonObject, is_page, mapping, python_type, sequence

_HEAD: Final = '''"""{about}

Written by `make generated` from `{source}`; do not edit.
"""

from collections.abc import Mapping, Sequence
from datetime import datetime
from typing import Literal

from pydantic import Field

from distalock.client.base import Page, ReceivedModel, SentModel
'''
_EXAMPLES: Final = "/examples/"
# Names that the models' base class has itself.
_RENAMED: Final = {"schema": "schema_name"}


def models_source(document: JsonObject) -> str:
    """`models.py`: every schema of the interface that is no page."""
    schemas = mapping(mapping(document["components"])["schemas"])
    sent = _sent_names(document, schemas)
    about = "What the gateway takes and answers, one model for each schema of its interface."
    return _HEAD.format(about=about, source="docs/openapi.json") + _definitions(schemas, schemas, sent)


def event_models_source(document: JsonObject, known: Iterable[str]) -> str:
    """`event_models.py`: what events carry, and which kind carries what; `known` are the names in `models.py`."""
    components = mapping(document["components"])
    schemas, messages = mapping(components["schemas"]), mapping(components["messages"])
    data_of_kind = {
        kind: _data_name(mapping(message)) for kind, message in messages.items() if "name" in mapping(message)
    }
    wanted = _reachable(set(data_of_kind.values()), schemas)
    known = set(known)
    taken = sorted(wanted & known)
    imports = f"from distalock.client.models import {', '.join(taken)}\n" if taken else ""
    own = {name: schemas[name] for name in schemas if name in wanted - known}
    table = "".join(f"    {kind!r}: {name},\n" for kind, name in data_of_kind.items())
    union = " | ".join(dict.fromkeys(data_of_kind.values()))
    return (
        _HEAD.format(about="What each kind of event carries.", source="docs/asyncapi.json")
        + imports
        + _definitions(own, schemas, set())
        + f"\n\nEventData = {union}\n\n"
        + f"DATA_OF_KIND: Mapping[str, type[EventData]] = {{\n{table}}}\n"
    )


def _data_name(message: JsonObject) -> str:
    properties = mapping(mapping(message["payload"])["properties"])
    return str(mapping(properties["data"])["$ref"]).rpartition("/")[2]


def _definitions(schemas: Mapping[str, object], everything: Mapping[str, object], sent: set[str]) -> str:
    ordered = [name for name in _in_order(everything) if name in schemas and not is_page(name)]
    return "".join(_definition(name, mapping(schemas[name]), sent=name in sent) for name in ordered)


def _definition(name: str, schema: JsonObject, *, sent: bool) -> str:
    if "properties" not in schema and schema.get("type") != "object":
        return f"\n\n{name} = {python_type(schema, sent=sent)}\n"
    required = {str(one) for one in sequence(schema.get("required", []))}
    fields = [
        _field(key, mapping(value), needed=key in required, sent=sent)
        for key, value in mapping(schema.get("properties", {})).items()
        if not mapping(value).get("deprecated")
    ]
    base = "SentModel" if sent else "ReceivedModel"
    return (
        f"\n\nclass {name}({base}):\n    {_docstring(schema, name)}\n"
        + ("\n" if fields else "")
        + "".join(f"    {field}" for field in fields)
    )


def _docstring(schema: JsonObject, name: str) -> str:
    says = str(schema.get("description", f"`{name}` of the interface.")).strip()
    return '"""' + says.replace("\n", "\n    ") + ("\n    " if "\n" in says else "") + '"""'


def _field(key: str, schema: JsonObject, *, needed: bool, sent: bool) -> str:
    options = []
    kind = python_type(schema, sent=sent)
    if not needed:
        default, kind = _default(schema, kind)
        options.append(f"default={default}")
    if key in _RENAMED:
        options.append(f"alias={key!r}")
    if "format': 'password'" in str(schema):
        options.append("repr=False")
    if "description" in schema:
        options.append(f"description={json.dumps(str(schema['description']), ensure_ascii=False)}")
    name = _RENAMED.get(key, key)
    return f"{name}: {kind}" + (f" = Field({', '.join(options)})" if options else "") + "\n"


def _default(schema: JsonObject, kind: str) -> tuple[str, str]:
    """The default's source, and the type with what it may be besides."""
    if schema.get("type") == "array":
        return "()", kind
    if "default" in schema:
        return repr(schema["default"]), kind
    return "None", kind if "None" in kind else f"{kind} | None"


def _sent_names(document: JsonObject, schemas: JsonObject) -> set[str]:
    bodies = [
        mapping(operation)["requestBody"]
        for path in mapping(document["paths"]).values()
        for operation in mapping(path).values()
        if "requestBody" in mapping(operation)
    ]
    return _reachable({name for body in bodies for name in _references(body)}, schemas)


def _reachable(names: set[str], schemas: Mapping[str, object]) -> set[str]:
    found: set[str] = set()
    while names:
        found |= names
        names = {one for name in names for one in _references(schemas[name])} - found
    return found


def _in_order(schemas: Mapping[str, object]) -> list[str]:
    """Each after those that it refers to."""
    ordered: dict[str, None] = {}

    def put(name: str) -> None:
        if name not in ordered:
            for one in sorted(_references(schemas[name])):
                put(one)
            ordered[name] = None

    for name in schemas:
        put(name)
    return list(ordered)


def _references(value: object) -> set[str]:
    """Schemas that a part of the document refers to; examples are none."""
    if isinstance(value, dict):
        reference = str(value.get("$ref", ""))
        own = {reference.rpartition("/")[2]} if reference and _EXAMPLES not in reference else set()
        return own.union(*(_references(inner) for inner in value.values()))
    return set().union(*(_references(inner) for inner in value)) if isinstance(value, list) else set()
