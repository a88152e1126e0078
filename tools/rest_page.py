"""`docs/rest.md`: written by hand, but for the tables of paths, of who may do what and of the kinds of events."""

from collections.abc import Callable, Iterator
from dataclasses import fields
from inspect import getdoc
from pathlib import Path
from typing import Any, Final

from services.ui_api.app import openapi_document, routed_app
from services.ui_api.core.events import DATA_OF_KIND
from services.ui_api.core.roles import permission_lines
from services.ui_api.routes.routers import PREFIX

_PAGE: Final = Path(__file__).parents[1] / "docs" / "rest.md"
_HEADERS: Final = {"Idempotency-Key": "key", "If-Match": "match"}
# OpenAPI knows no WebSockets, and does not list itself.
_BESIDE: Final = (
    ("WS /live", "The newest image and guidance."),
    ("GET /openapi.json", "This interface, bodies and all."),
    ("GET /docs", "The same as a page, with examples and links."),
)


def path_lines() -> list[str]:
    """The table of all paths in Markdown: what each is for, by the document, and what its request needs."""
    document: dict[str, Any] = openapi_document(routed_app())
    rows = [
        f"| `{method.upper()} {path.removeprefix(PREFIX)}` | {_purpose(operation)} | {', '.join(_marks(operation))} |"
        for path, methods in document["paths"].items()
        for method, operation in methods.items()
    ]
    return ["| path | | |", "|---|---|---|", *rows, *(f"| `{path}` | {purpose} | |" for path, purpose in _BESIDE)]


def _purpose(operation: dict[str, Any]) -> str:
    return str(operation["description"]).partition("\n\n")[0].replace("\n", " ")


def _marks(operation: dict[str, Any]) -> Iterator[str]:
    """What of the page's conventions holds for an operation."""
    named = {parameter["name"] for parameter in operation.get("parameters", ()) if parameter.get("required")}
    yield from (mark for header, mark in _HEADERS.items() if header in named)
    yield from (status for status in ("201", "202") if status in operation["responses"])
    if "#/components/schemas/Page_" in str(operation["responses"].get("200")):
        yield "list"


def event_lines() -> list[str]:
    """The table of the kinds of events in Markdown: what each says, and the fields of its `data`."""
    rows = []
    for kind, data in DATA_OF_KIND.items():
        says = (getdoc(data) or "").partition("\n\n")[0].replace("\n", " ")
        names = ", ".join(f"`{field.name}`" for field in fields(data))
        rows.append(f"| `{kind}` | {says} | {names} |")
    return ["| `event` | | fields of `data` |", "|---|---|---|", *rows]


_TABLES: Final[dict[str, Callable[[], list[str]]]] = {
    "paths": path_lines,
    "permissions": permission_lines,
    "event kinds": event_lines,
}


def rest_page() -> str:
    """The page with each table between its markers."""
    page = _PAGE.read_text(encoding="utf-8")
    for name, lines in _TABLES.items():
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        before, rest = page.split(begin)
        _, after = rest.split(end)
        page = f"{before}{begin}\n" + "\n".join(lines()) + f"\n{end}{after}"
    return page
