"""What of the interface's operations the client needs, read from the OpenAPI document."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from tools.client.types import JsonObject, is_page, mapping, python_type, sequence, type_name

# Pages for browsers; streams and sparse lists, whose members are not whole, are no calls with one typed answer.
_LEFT_OUT_TAGS: Final = frozenset({"first account"})
_STREAM: Final = "text/event-stream"
_LEFT_OUT_PARAMETERS: Final = frozenset({"fields"})
_KEY: Final = "Idempotency-Key"
_MATCH: Final = "if-match"
MATCHES: Final = "x-distalock-if-match"


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of the path or the query, and the source of its type and default."""

    name: str
    kind: str
    default: str | None


@dataclass(frozen=True, slots=True)
class Operation:
    """An operation as the client calls it.

    Attributes
    ----------
    body, answer
        Source of the type; None where nothing is sent or answered.
    body_needed
        Whether the body has members that must be given.
    matches
        Path of the resource whose ETag is quoted; None where none is.
    """

    name: str
    method: str
    path: str
    says: str
    path_parameters: tuple[Parameter, ...]
    query: tuple[Parameter, ...]
    body: str | None
    body_needed: bool
    answer: str | None
    is_page: bool
    is_keyed: bool
    matches: str | None


def operations_of(document: JsonObject) -> Iterator[Operation]:
    """Every operation that answers with a document or a file."""
    schemas = mapping(mapping(document["components"])["schemas"])
    for path, methods in mapping(document["paths"]).items():
        for method, described in mapping(methods).items():
            operation = mapping(described)
            if not _is_left_out(operation):
                yield _operation(path, method, operation, schemas)


def _is_left_out(operation: JsonObject) -> bool:
    """Whether it is for browsers alone (a page, a redirection), or a stream."""
    tags, answers = set(map(str, sequence(operation.get("tags", [])))), mapping(operation["responses"])
    leads_elsewhere = not any(status.startswith("2") for status in answers)
    return bool(_LEFT_OUT_TAGS & tags) or leads_elsewhere or _STREAM in str(answers)


def _operation(path: str, method: str, described: JsonObject, schemas: JsonObject) -> Operation:
    parameters = [mapping(one) for one in sequence(described.get("parameters", []))]
    headers = {str(one["name"]).lower() for one in parameters if one["in"] == "header"}
    answer, paged = _answer(described)
    body, needed = _body(described, schemas)
    return Operation(
        name=str(described["operationId"]),
        method=method.upper(),
        path=path,
        says=str(described["description"]),
        path_parameters=tuple(_parameter(one) for one in parameters if one["in"] == "path"),
        query=tuple(
            _parameter(one) for one in parameters if one["in"] == "query" and one["name"] not in _LEFT_OUT_PARAMETERS
        ),
        body=body,
        body_needed=needed,
        answer=answer,
        is_page=paged,
        is_keyed=_KEY.lower() in headers,
        matches=str(described[MATCHES]) if _MATCH in headers else None,
    )


def _parameter(described: JsonObject) -> Parameter:
    schema = mapping(described["schema"])
    default = None if described["required"] else repr(schema.get("default"))
    kind = python_type(schema, sent=True)
    if default == "None" and "None" not in kind:
        kind += " | None"
    return Parameter(str(described["name"]), kind, default)


def _answer(described: JsonObject) -> tuple[str | None, bool]:
    """The type of the answer when all goes well, and whether it is a page."""
    responses = mapping(described["responses"])
    content = next(
        mapping(mapping(answer).get("content", {})) for status, answer in responses.items() if status.startswith("2")
    )
    if not content:
        return None, False
    kind, media = next(iter(content.items()))
    schema = mapping(mapping(media).get("schema", {}))
    if kind != "application/json":
        return ("str" if kind.startswith("text/") else "bytes"), False
    if not schema:  # a file that is served byte for byte
        return "bytes", False
    name = str(schema.get("$ref", "")).rpartition("/")[2]
    return (type_name(name) if name else python_type(schema, sent=False)), is_page(name)


def _body(described: JsonObject, schemas: JsonObject) -> tuple[str | None, bool]:
    """The type of the body, and whether one must be given; None for one that has no members any more."""
    found = re.search(r"#/components/schemas/(\w+)", str(described.get("requestBody", "")))
    if found is None:
        return None, False
    schema = mapping(schemas[found[1]])
    if all(mapping(one).get("deprecated") for one in mapping(schema["properties"]).values()):
        return None, False
    return found[1], bool(schema.get("required") or schema.get("minProperties"))
