"""`docs/rest.md` lists every path of the interface, and speaks of none that there is not."""

import json
import re
from pathlib import Path

_DOCS = Path(__file__).parents[3] / "docs"
_PAGE = (_DOCS / "rest.md").read_text(encoding="utf-8")
_METHODS = "GET|POST|PUT|PATCH|DELETE"
# Not in the document: OpenAPI knows no WebSockets, and does not list itself.
_BESIDE = {"WS /live", "GET /openapi.json", "GET /docs"}


def _there() -> set[str]:
    """Method and path of every operation, without prefix, parameters as `{}`."""
    paths = json.loads((_DOCS / "openapi.json").read_text(encoding="utf-8"))["paths"]
    return {
        f"{method.upper()} {_plain(path.removeprefix('/api/v1'))}"
        for path, methods in paths.items()
        for method in methods
    } | _BESIDE


def _plain(path: str) -> str:
    """A path with everything that stands for a parameter as `{}`: names in braces, and numbers as examples."""
    return re.sub(r"(?<=/)\d+(?=/|$)", "{}", re.sub(r"\{\w+\}", "{}", path.split("?")[0]))


def test_every_path_is_in_the_table() -> None:
    rows = re.findall(rf"^\| `((?:{_METHODS}|WS) [^`]+)` \|", _PAGE, re.MULTILINE)
    listed = [f"{method} {_plain(path)}" for method, path in (row.split(" ", 1) for row in rows)]
    assert sorted(listed) == sorted(_there())


def test_no_other_path_is_spoken_of() -> None:
    spoken = re.findall(rf"`({_METHODS}|WS) ([/…][^` ]*)`", _PAGE)
    assert len(spoken) > 40
    there = _there()
    for method, path in spoken:
        wanted = _plain(path.replace("…/", "/"))
        known = [one for one in there if one.startswith(f"{method} ")]
        assert any(one.endswith(wanted) if "…" in path else one == f"{method} {wanted}" for one in known), (
            method,
            path,
        )
