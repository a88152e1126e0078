"""Writes a golden message for every message that has none: ``python -m tests.contract.messages.make_golden``.

Existing golden messages are never written again: they stand for what is on disks and wires already. When a message
changes so that its golden one no longer decodes, it needs a new version number (``distalock/frame/2``), and the decoder
of the old one stays.
"""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from shared.messages.base import decode, encode
from shared.messages.schema_files import file_stem, message_types

GOLDEN = Path(__file__).with_name("golden")
_BY_PATTERN = {"^[0-9a-f]{64}$": "0f" * 32, "^[0-9a-f]{128}$": "0f" * 64, "^[A-Za-z0-9][A-Za-z0-9._-]*$": "Example-1.a"}
Schema = Mapping[str, object]


def example(schema: Schema, definitions: Mapping[str, Schema]) -> object:
    """A value that a JSON schema, as pydantic writes them, allows: the richest alternative, one item per list."""
    match schema:
        case {"$ref": str(reference)}:
            return example(definitions[reference.removeprefix("#/$defs/")], definitions)
        case {"const": constant}:
            return constant
        case {"enum": [first, *_]}:
            return first
        case {"anyOf": [dict(first), *_]}:
            return example(first, definitions)
        case {"type": "object", "properties": dict(properties)}:
            return {name: example(item, definitions) for name, item in properties.items()}
        case {"type": "array", "prefixItems": list(items)}:
            return [example(item, definitions) for item in items]
        case {"type": "array", "items": dict(item)}:
            return [example(item, definitions)]
    return _scalar(schema)


def _scalar(schema: Schema) -> object:
    match schema:
        case {"type": "string"}:
            return _BY_PATTERN.get(str(schema.get("pattern")), "text")
        case {"type": "boolean"}:
            return True
        case {"type": "integer" | "number"}:
            return _number(schema)
    raise ValueError(f"no example for {schema}")


def _number(schema: Schema) -> float:
    lowest, highest = schema.get("minimum", schema.get("exclusiveMinimum", 3)), schema.get("maximum", 64)
    assert isinstance(lowest, int | float)
    assert isinstance(highest, int | float)
    middle = 0.5 * (lowest + highest)
    return int(middle) if schema["type"] == "integer" else middle


def missing() -> Sequence[str]:
    """Schema names of the messages without a golden one."""
    return [name for name in message_types() if not (GOLDEN / f"{file_stem(name)}.json").exists()]


def main() -> None:
    """Write what is missing."""
    for name in missing():
        kind = message_types()[name]
        schema = kind.model_json_schema(by_alias=True)
        text = json.dumps(example(schema, schema.get("$defs", {})))
        file = GOLDEN / f"{file_stem(name)}.json"
        file.write_bytes(encode(decode(kind, text.encode())) + b"\n")
        print(file)


if __name__ == "__main__":
    main()
