"""The gateway gone for ten seconds in every state of the procedure: what the page says, and whether it comes back."""

import os
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

from playwright.sync_api import Page

from benchmarks.common.operating_room import OperatingRoom
from benchmarks.console.browser import browser, new_context, sign_in
from benchmarks.console.operator import ConsoleOperator
from benchmarks.console.section import Section, table
from benchmarks.robot.process_figures import family
from services.ui_api.core.access_settings import DEMO_USER

TITLE: Final = "Without the gateway"
GONE_S: Final = 10.0
SAID_WITHIN_S: Final = 2.0
BACK_WITHIN_S: Final = 5.0
# What would look live although nothing is known: nothing of it may be there.
_LOOKS_LIVE: Final = (
    ".connection.live",
    ".robot:not(.not-live)",
    ".xray:not(:has(.not-live))",
    ".scene-picture:not(:has(.scene-stale))",
)


@dataclass(frozen=True, slots=True)
class Absence:
    """One of them.

    Attributes
    ----------
    live
        What looked live two seconds after the gateway had gone.
    """

    state: str
    said_s: float
    back_s: float
    live: tuple[str, ...]
    is_same: bool

    @property
    def holds(self) -> bool:
        """Whether all of it is as it should be."""
        return self.said_s <= SAID_WITHIN_S and self.back_s <= BACK_WITHIN_S and not self.live and self.is_same


def measure(site: OperatingRoom) -> Section:
    """The processes of the gateway stand still, so that connections hang: worse for a page than a refusal."""
    with browser() as chromium, new_context(chromium) as context:
        page = context.new_page()
        sign_in(page, site.installation.ports.rest_url, DEMO_USER, site.installation.token)
        operator = ConsoleOperator(page, site.installation.token)
        page.wait_for_selector("text=The virtual room proposes")
        found = [_absence(site, page, "no case")]
        for state in operator.states():
            found.append(_absence(site, page, state))
            if state == "motion: start_motion" and len([one for one in found if one.state == "moving"]) == 0:
                operator.press_and_hold()
                page.wait_for_selector(".robot .lamp.moving")
                found.append(_absence(site, page, "moving"))
                page.mouse.up()
        found.append(_absence(site, page, "closed"))
    return section_of(found)


def _absence(site: OperatingRoom, page: Page, state: str) -> Absence:
    page.wait_for_selector(".connection.live")
    before = page.evaluate(_WHERE)
    with _gone(site):
        gone_s = time.monotonic()
        page.wait_for_selector(".connection.lost")
        said_s = time.monotonic() - gone_s
        page.wait_for_timeout(max(0.0, 1e3 * (SAID_WITHIN_S - said_s)))
        live = tuple(one for one in _LOOKS_LIVE if page.locator(one).count() > 0)
        page.wait_for_timeout(1e3 * (GONE_S - (time.monotonic() - gone_s)))
    back_s = time.monotonic()
    page.wait_for_selector(".connection.live")
    back_s = time.monotonic() - back_s
    page.wait_for_timeout(500)
    # A motion has ended meanwhile, because nobody held it.
    is_same = state == "moving" or page.evaluate(_WHERE) == before
    return Absence(state, said_s, back_s, live, is_same)


_WHERE: Final = (
    "(document.querySelector('.procedure') ?? document.querySelector('.no-case') ?? {}).dataset?.phase ?? ''"
)


@contextmanager
def _gone(site: OperatingRoom) -> Iterator[None]:
    pids = family({"ui_api": site.fleet.pids["ui_api"]}).values()
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        for pid in pids:
            os.kill(pid, signal.SIGCONT)


def section_of(found: list[Absence]) -> Section:
    """A row for each state."""
    rows = [
        (
            one.state,
            f"{one.said_s:.1f} s",
            ", ".join(one.live) or "nothing",
            f"{one.back_s:.1f} s",
            "yes" if one.is_same else "NO",
        )
        for one in found
    ]
    text = (
        f"The gateway's processes stand still for {GONE_S:.0f} s. Limits: said within {SAID_WITHIN_S:.0f} s, nothing "
        f"that looks live then, back by itself within {BACK_WITHIN_S:.0f} s, in the same state.\n\n"
        + table(("state", "said after", "looks live", "back after", "same state"), rows)
    )
    return Section(TITLE, text, all(one.holds for one in found))
