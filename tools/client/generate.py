"""The client's generated modules: path and formatted source."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Final

from services.ui_api.app import openapi_document, routed_app
from tools.asyncapi import asyncapi_document
from tools.client.calls import calls_source, methods_source
from tools.client.models import event_models_source, models_source
from tools.client.operations import operations_of
from tools.client.types import JsonObject, mapping

_CLIENT: Final = Path(__file__).parents[2] / "distalock" / "client"


def client_files() -> dict[Path, str]:
    """Every generated module of the client."""
    document, events = _plain(openapi_document(routed_app())), _plain(asyncapi_document())
    operations = tuple(operations_of(document))
    sources = {
        "models.py": models_source(document),
        "event_models.py": event_models_source(events, mapping(mapping(document["components"])["schemas"])),
        "calls.py": calls_source(operations),
        "methods.py": methods_source(operations, is_async=False),
        "async_methods.py": methods_source(operations, is_async=True),
    }
    return {_CLIENT / name: _formatted(source, name) for name, source in sources.items()}


def _plain(document: object) -> JsonObject:
    """A document as everybody else reads it: JSON, without types of our own."""
    return mapping(json.loads(json.dumps(document)))


def _formatted(source: str, name: str) -> str:
    """As `ruff` leaves it, without the imports that nothing uses."""
    ruff = [sys.executable, "-m", "ruff"]
    checked = [*ruff, "check", "--quiet", "--fix", "--select", "F401,I", "--stdin-filename", str(_CLIENT / name), "-"]
    formatted = [*ruff, "format", "--quiet", "--stdin-filename", str(_CLIENT / name), "-"]
    for command in (checked, formatted):
        source = subprocess.run(command, input=source, capture_output=True, text=True, check=True).stdout  # noqa: S603 - our own words
    return source
