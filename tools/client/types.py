"""Python types of JSON schemas, as source text."""

from collections.abc import Mapping
from typing import Final

JsonObject = dict[str, object]
_SIMPLE: Final = {"string": "str", "integer": "int", "number": "float", "boolean": "bool", "null": "None"}
_FORMATS: Final = {"date-time": "datetime"}
_PAGE: Final = "Page_"


def mapping(value: object) -> JsonObject:
    """A part of the document that must be an object; raises `TypeError`."""
    if not isinstance(value, dict):
        raise TypeError(f"expected an object in the document, got {type(value).__name__}")
    return value


def sequence(value: object) -> list[object]:
    """A part of the document that must be an array; raises `TypeError`."""
    if not isinstance(value, list):
        raise TypeError(f"expected an array in the document, got {type(value).__name__}")
    return value


def python_type(schema: Mapping[str, object], *, sent: bool) -> str:
    """The type of a schema; arrays of what is sent are any sequences, of what is received tuples."""
    if "$ref" in schema:
        return type_name(str(schema["$ref"]).rpartition("/")[2])
    if "anyOf" in schema:
        return " | ".join(dict.fromkeys(python_type(mapping(one), sent=sent) for one in sequence(schema["anyOf"])))
    if "const" in schema:
        return f"Literal[{schema['const']!r}]"
    if "enum" in schema:
        return f"Literal[{', '.join(map(repr, sequence(schema['enum'])))}]"
    return _container(schema, sent=sent) or _scalar(schema)


def type_name(schema_name: str) -> str:
    """The name of a schema's type: a page of views is one generic type."""
    if not schema_name.startswith(_PAGE):
        return schema_name
    return f"Page[{schema_name.removeprefix(_PAGE).rstrip('_')}]"


def is_page(schema_name: str) -> bool:
    """Whether a schema is a page of a list."""
    return schema_name.startswith(_PAGE)


def _container(schema: Mapping[str, object], *, sent: bool) -> str:
    if "prefixItems" in schema:
        members = [python_type(mapping(one), sent=sent) for one in sequence(schema["prefixItems"])]
        return f"tuple[{', '.join(members)}]"
    if schema.get("type") == "array":
        item = python_type(mapping(schema.get("items", {})), sent=sent)
        return f"Sequence[{item}]" if sent else f"tuple[{item}, ...]"
    if schema.get("type") == "object":
        values = schema.get("additionalProperties")
        value = python_type(values, sent=sent) if isinstance(values, dict) and values else "object"
        return f"Mapping[str, {value}]" if sent else f"dict[str, {value}]"
    return ""


def _scalar(schema: Mapping[str, object]) -> str:
    if schema.get("format") in _FORMATS:
        return _FORMATS[str(schema["format"])]
    return _SIMPLE.get(str(schema.get("type")), "object")
