"""What a browser loads until a case is shown with its picture in space."""

from collections import Counter
from typing import Final

from playwright.sync_api import Request

from benchmarks.common.operating_room import OperatingRoom
from benchmarks.console.browser import browser, new_context, sign_in
from benchmarks.console.operator import ConsoleOperator
from benchmarks.console.section import Section, table
from services.ui_api.core.access_settings import DEMO_USER

TITLE: Final = "First load"
LIMIT_BYTES: Final = 1_000_000
_KB: Final = 1e3


def measure(site: OperatingRoom) -> Section:
    """Bodies as they come over the wire, of the page's own files."""
    ended: list[Request] = []
    with browser() as chromium, new_context(chromium) as context:
        page = context.new_page()

        def note(request: Request) -> None:
            ended.append(request)

        # Of the whole context, for workers load files too; at its end, for an answer's head does not know the size.
        context.on("requestfinished", note)
        sign_in(page, site.installation.ports.rest_url, DEMO_USER, site.installation.token)
        operator = ConsoleOperator(page, site.installation.token)
        operator.open_case()
        operator.run_until(lambda one: (one.phase, one.next_action) == ("plan", "request_plan"))
        page.wait_for_selector(".scene-picture canvas")
        page.wait_for_timeout(1_000)
        loaded: Counter[str] = Counter()
        for request in tuple(ended):
            path = request.url.removeprefix(site.installation.ports.rest_url)
            if path == "/" or path.startswith("/assets/"):
                loaded[_kind_of(path)] += _size(request)
        operator.abandon()
    return section_of(loaded)


def _size(request: Request) -> int:
    """Bytes of an answer's body; of a worker's file the browser says no more than the answer's own length."""
    response = request.response()
    stated = None if response is None else response.header_value("content-length")
    return request.sizes()["responseBodySize"] or int(stated or 0)


def _kind_of(path: str) -> str:
    return path.rpartition(".")[2] if "." in path else "html"


def section_of(loaded: Counter[str]) -> Section:
    """By kind of file, and together."""
    together = sum(loaded.values())
    rows = [(kind, f"{size / _KB:.0f} kB") for kind, size in loaded.most_common()]
    text = (
        "Files of the page over the wire, compressed, from an empty cache to a case with image and scene. "
        f"Limit: {LIMIT_BYTES / _KB:.0f} kB.\n\n"
        + table(("kind", "size"), [*rows, ("together", f"{together / _KB:.0f} kB")])
    )
    return Section(TITLE, text, 0 < together <= LIMIT_BYTES)
