"""`docs/rest.md`: written by hand, but for the table of who may do what."""

from pathlib import Path
from typing import Final

from services.ui_api.core.roles import permission_lines

_PAGE: Final = Path(__file__).parents[1] / "docs" / "rest.md"
_BEGIN, _END = "<!-- permissions: begin -->", "<!-- permissions: end -->"


def rest_page() -> str:
    """The page with the table between its markers."""
    before, rest = _PAGE.read_text(encoding="utf-8").split(_BEGIN)
    _, after = rest.split(_END)
    table = "\n".join(permission_lines())
    return f"{before}{_BEGIN}\n{table}\n{_END}{after}"
