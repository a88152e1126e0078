"""From an image, and from its localisation, at the gateway to what is seen of them in the page."""

import json
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Final

import httpx
from playwright.sync_api import Page

from benchmarks.common.operating_room import OperatingRoom
from benchmarks.common.statistics import quantiles
from benchmarks.console.browser import browser, new_context, sign_in
from benchmarks.console.operator import ConsoleOperator
from benchmarks.console.section import Section, table
from distalock.rest_client import bearer
from services.ui_api.core.access_settings import DEMO_USER

TITLE: Final = "From the gateway to the screen"
IMAGES: Final = 20
LIMIT_MS: Final = 200.0
_PATIENCE_MS: Final = 60_000.0
# Notes when a picture and an overlay of an image are first on the screen: in the frame after the one that drew them.
_WATCH: Final = """() => {
    const seen = (globalThis.seen = { picture: {}, overlay: {} });
    const look = () => {
        const now = performance.timeOrigin + performance.now();
        for (const [kind, where] of [["picture", "canvas.picture"], ["overlay", "svg.overlay:has(.nail)"]])
            for (const one of document.querySelectorAll(where)) seen[kind][one.dataset.image] ??= now;
        requestAnimationFrame(look);
    };
    requestAnimationFrame(look);
}"""


class GatewaysEvents:
    """When the gateway put images and their localisations on record, in ms since 1970, by the image's hash."""

    def __init__(self) -> None:
        self.images_ms: dict[str, float] = {}
        self.localisations_ms: dict[str, float] = {}

    def follow(self, http: httpx.Client, case_id: str) -> None:
        """Until the connection ends."""
        try:
            with http.stream("GET", f"/api/v1/cases/{case_id}/events", timeout=None) as stream:
                for line in stream.iter_lines():
                    if line.startswith("data: "):
                        self._take(json.loads(line.removeprefix("data: ")))
        except httpx.HTTPError:
            return

    def _take(self, event: Mapping[str, object]) -> None:
        data, at_ms = event["data"], int(str(event["at_ns"])) / 1e6
        assert isinstance(data, dict)
        if event["kind"] == "image_received":
            self.images_ms.setdefault(str(data["image_sha256"]), at_ms)
        elif event["kind"] == "localisation_received":
            self.localisations_ms.setdefault(str(data["image_sha256"]), at_ms)


def measure(site: OperatingRoom, images: int = IMAGES) -> Section:
    """One image after another, each localised before the next."""
    with browser() as chromium, new_context(chromium) as context:
        page = context.new_page()
        sign_in(page, site.installation.ports.rest_url, DEMO_USER, site.installation.token)
        operator = ConsoleOperator(page, site.installation.token)
        operator.open_case()
        operator.run_until(lambda one: (one.phase, one.next_action) == ("plan", "request_plan"))
        page.evaluate(_WATCH)
        watched_from_ms = page.evaluate("performance.timeOrigin + performance.now()")
        (case,) = site.gateway.list_cases(status="open").items
        with _followed(site, case.id) as events:
            for _ in range(images):
                _one(page, site)
            seen = page.evaluate("globalThis.seen")
        operator.abandon()

    def after_ms(kind: str, recorded_ms: Mapping[str, float]) -> list[float]:
        shown = seen[kind]
        return [shown[one] - at for one, at in recorded_ms.items() if one in shown and at >= watched_from_ms]

    return section_of(after_ms("picture", events.images_ms), after_ms("overlay", events.localisations_ms))


def _one(page: Page, site: OperatingRoom) -> None:
    before = page.locator("canvas.picture").first.get_attribute("data-image")
    site.room.take_shot()
    page.wait_for_function(
        """(before) => {
            const shown = document.querySelector("canvas.picture")?.dataset.image;
            return shown !== before && document.querySelector(`svg.overlay[data-image="${shown}"] .nail`) !== null;
        }""",
        arg=before,
        timeout=_PATIENCE_MS,
    )


@contextmanager
def _followed(site: OperatingRoom, case_id: str) -> Iterator[GatewaysEvents]:
    events = GatewaysEvents()
    url = site.installation.ports.rest_url
    with httpx.Client(base_url=url, headers=bearer(site.installation.token)) as http:
        threading.Thread(target=events.follow, args=(http, case_id), daemon=True).start()
        yield events


def section_of(pictures_ms: list[float], overlays_ms: list[float]) -> Section:
    """Median, 95 % and worst of both."""
    found = {
        "image on record → picture on the screen": pictures_ms,
        "localisation on record → overlay on the screen": overlays_ms,
    }
    rows = []
    for name, values in found.items():
        median, most, worst = quantiles(values)
        rows.append((name, str(len(values)), f"{median:.0f} ms", f"{most:.0f} ms", f"{worst:.0f} ms"))
    text = (
        "By the time of the event at the gateway and the frame in which the page first shows it; one clock, because "
        f"both run on this machine. Limit: {LIMIT_MS:.0f} ms in 95 %.\n\n"
        + table(("from → to", "images", "median", "95 %", "worst"), rows)
    )
    holds = all(values and quantiles(values)[1] <= LIMIT_MS for values in found.values())
    return Section(TITLE, text, holds)
