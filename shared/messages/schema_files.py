"""Writes the JSON schema of every message to `shared/messages/schemas/`, or checks that they are there and up to date.

``python -m shared.messages.schema_files`` writes, ``python -m shared.messages.schema_files --check`` compares (exit 1).
"""

import argparse
import importlib
import json
import pkgutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

import shared.messages
from shared.messages.base import Message

SCHEMAS = Path(__file__).with_name("schemas")


def message_types() -> dict[str, type[Message]]:
    """Every message by its schema name, such as ``distalock/frame/1``."""
    for module in pkgutil.iter_modules(shared.messages.__path__, "shared.messages."):
        importlib.import_module(module.name)
    # A service may derive a view of its own from a message; that is no message of the bus.
    ours = (kind for kind in _concrete(Message) if kind.__module__.startswith("shared.messages."))
    return {schema_name(kind): kind for kind in ours}


def schema_name(kind: type[Message]) -> str:
    """The literal that stands in a message's ``schema``."""
    (name,) = get_args(kind.model_fields["schema_name"].annotation)
    return str(name)


def file_stem(name: str) -> str:
    """``distalock/frame/1`` to ``frame-1``."""
    return name.removeprefix("distalock/").replace("/", "-")


def schema_texts() -> dict[str, str]:
    """File name and content of every schema."""
    return {
        f"{file_stem(name)}.json": json.dumps(kind.model_json_schema(by_alias=True), indent=2, sort_keys=True) + "\n"
        for name, kind in message_types().items()
    }


def differences(folder: Path = SCHEMAS) -> list[str]:
    """What is wrong with the committed schemas, one sentence each; empty when nothing is."""
    wanted = schema_texts()
    there = {file.name: file.read_text(encoding="utf-8") for file in folder.glob("*.json")}
    return [
        *(f"{name} is missing" for name in sorted(wanted.keys() - there.keys())),
        *(f"{name} belongs to no message" for name in sorted(there.keys() - wanted.keys())),
        *(f"{name} is out of date" for name in sorted(wanted.keys() & there.keys()) if wanted[name] != there[name]),
    ]


def write(folder: Path = SCHEMAS) -> None:
    """Write all schemas; files that belong to no message stay, for `differences` to point at."""
    folder.mkdir(exist_ok=True)
    for name, text in schema_texts().items():
        (folder / name).write_text(text, encoding="utf-8")


def main(arguments: Sequence[str] | None = None) -> int:
    """Write or check; 1 when a check fails."""
    parser = argparse.ArgumentParser(prog="python -m shared.messages.schema_files", description=main.__doc__)
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    if not parser.parse_args(arguments).check:
        write()
        return 0
    found = differences()
    for sentence in found:
        print(  # noqa: T201 - a command's output
            f"schemas: {sentence}; run python -m shared.messages.schema_files and commit", file=sys.stderr
        )
    return 1 if found else 0


def _concrete(kind: type[Message]) -> list[type[Message]]:
    return [
        found
        for subclass in kind.__subclasses__()
        for found in ([subclass] if "schema_name" in subclass.model_fields else []) + _concrete(subclass)
    ]


if __name__ == "__main__":
    sys.exit(main())
