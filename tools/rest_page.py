"""`docs/rest.md`: written by hand, but for the tables of who may do what and of the kinds of events."""

from collections.abc import Callable
from dataclasses import fields
from inspect import getdoc
from pathlib import Path
from typing import Final

from services.ui_api.core.events import DATA_OF_KIND
from services.ui_api.core.roles import permission_lines

_PAGE: Final = Path(__file__).parents[1] / "docs" / "rest.md"


def event_lines() -> list[str]:
    """The table of the kinds of events in Markdown: what each says, and the fields of its `data`."""
    rows = []
    for kind, data in DATA_OF_KIND.items():
        says = (getdoc(data) or "").partition("\n\n")[0].replace("\n", " ")
        names = ", ".join(f"`{field.name}`" for field in fields(data))
        rows.append(f"| `{kind}` | {says} | {names} |")
    return ["| `event` | | fields of `data` |", "|---|---|---|", *rows]


_TABLES: Final[dict[str, Callable[[], list[str]]]] = {"permissions": permission_lines, "event kinds": event_lines}


def rest_page() -> str:
    """The page with each table between its markers."""
    page = _PAGE.read_text(encoding="utf-8")
    for name, lines in _TABLES.items():
        begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
        before, rest = page.split(begin)
        _, after = rest.split(end)
        page = f"{before}{begin}\n" + "\n".join(lines()) + f"\n{end}{after}"
    return page
