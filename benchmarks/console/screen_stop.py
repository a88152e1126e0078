"""From a finger on the page's stop to the stop byte on the controller's wire, while pictures are decoded and not."""

import random
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import numpy as np
from playwright.sync_api import Page

from benchmarks.console.browser import browser, new_context, sign_in
from benchmarks.console.section import Section, table
from benchmarks.robot.loads import ClientsOfAll, clients
from benchmarks.robot.stop_latency_rig import PATIENCE_S, StopRig, stop_rig
from services.ui_api.core.access_settings import DEMO_USER

TITLE: Final = "Stop on the screen"
TRIALS: Final = 100
LIMIT_P99_MS: Final = 100.0
_SEED: Final = 83


def measure(trials: int = TRIALS) -> Section:
    """Trials of both kinds in one installation and one page."""
    source = random.Random(_SEED)
    with stop_rig() as rig, _page(rig) as page:
        still = [_stopped_ms(rig, page, source) for _ in range(trials)]
        with clients(rig, ClientsOfAll(viewers=0, events=0, idle=0)):
            page.wait_for_selector("canvas.picture")
            running = [_stopped_ms(rig, page, source) for _ in range(trials)]
            shown = page.locator("canvas.picture").count() > 0
    return section_of({"no picture comes": still, "30 images/s of 2 MB come, and are decoded": running}, shown=shown)


@contextmanager
def _page(rig: StopRig) -> Iterator[Page]:
    with browser() as chromium, new_context(chromium) as context:
        page = context.new_page()
        sign_in(page, rig.installation.ports.rest_url, DEMO_USER, rig.installation.token)
        page.wait_for_selector(".procedure")
        yield page


def _stopped_ms(rig: StopRig, page: Page, source: random.Random) -> float:
    """One trial, somewhere in a motion; timed from before the browser is told of the finger."""
    page.locator(".stop-button").hover()
    rig.begin_motion(source)
    time.sleep(source.uniform(0.02, 0.15))
    rig.controller.stop_heard.clear()
    pressed_s = time.monotonic()
    page.mouse.down()
    page.mouse.up()
    if not rig.controller.stop_heard.wait(PATIENCE_S):
        raise TimeoutError(f"no stop byte within {PATIENCE_S:g} s")
    return 1e3 * (rig.controller.stopped_s - pressed_s)


def section_of(found: dict[str, list[float]], *, shown: bool) -> Section:
    """Median, 99 % and worst."""
    rows = [
        (name, str(len(ms)), *(f"{np.percentile(ms, percent):.1f} ms" for percent in (50, 99, 100)))
        for name, ms in found.items()
    ]
    text = (
        "A motion is under way; a mouse presses the page's STOP, and the virtual controller notes when the byte "
        f"arrives. The time begins before the browser is told of the press. Limit: {LIMIT_P99_MS:.0f} ms in 99 %.\n\n"
        + table(("meanwhile", "stops", "median", "99 %", "worst"), rows)
    )
    return Section(TITLE, text, shown and all(np.percentile(ms, 99) <= LIMIT_P99_MS for ms in found.values()))
