"""axe-core on every screen and in every state of a procedure, in each language at the end."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

from playwright.sync_api import Page

from benchmarks.common.operating_room import OperatingRoom
from benchmarks.console.accessibility import violations
from benchmarks.console.browser import browser, new_context, sign_in, start_page
from benchmarks.console.operator import ConsoleOperator
from benchmarks.console.section import Section, table
from services.ui_api.core.access_settings import DEMO_USER

TITLE: Final = "Accessibility"
_LANGUAGES: Final = ("de", "zh", "en")
_SCREENS: Final = ("cases", "users", "service", "wall")


@dataclass(slots=True)
class Looks:
    """Where axe looked, and what it found there."""

    found: dict[str, list[str]] = field(default_factory=dict)

    def look(self, page: Page, where: str) -> None:
        """Open what is folded, and ask axe."""
        page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
        self.found[where] = violations(page)


def measure(site: OperatingRoom) -> Section:
    """A whole procedure and every other screen."""
    looks = Looks()
    with browser() as chromium, new_context(chromium) as context:
        page = context.new_page()
        start_page(page, site.installation.ports.rest_url)
        page.wait_for_selector(".login")
        looks.look(page, "sign-in")
        sign_in(page, site.installation.ports.rest_url, DEMO_USER, site.installation.token)
        operator = ConsoleOperator(page, site.installation.token)
        page.wait_for_selector("text=The virtual room proposes")
        looks.look(page, "no case")
        for state in operator.states():
            looks.look(page, state)
            if state == "plan: request_plan":
                _image_tools(page, looks)
        _other_screens(page, looks)
    return section_of(looks)


def _image_tools(page: Page, looks: Looks) -> None:
    page.get_by_role("button", name="C-arm").first.click()
    page.wait_for_selector(".aim")
    looks.look(page, "C-arm guidance")
    page.get_by_role("button", name="Image", exact=True).click()
    page.context.set_offline(True)
    page.wait_for_selector(".connection.lost")
    looks.look(page, "no connection")
    page.context.set_offline(False)
    page.wait_for_selector(".connection.live")


def _other_screens(page: Page, looks: Looks) -> None:
    for where, language in _visits():
        page.evaluate(f"location.hash = '#/{where}'")
        page.wait_for_selector(".page-view h1" if where != "wall" else ".wall")
        page.locator("select[aria-label]").first.select_option(language) if where != "wall" else None
        page.wait_for_timeout(500)
        looks.look(page, f"{where} ({language})")
        if where == "cases":
            page.locator("table a").first.click()
            page.wait_for_selector(".timeline li")
            looks.look(page, f"record of a case ({language})")


def _visits() -> Iterator[tuple[str, str]]:
    yield from ((where, language) for language in _LANGUAGES for where in _SCREENS)


def section_of(looks: Looks) -> Section:
    """A row for each state with a violation, and how many there were without."""
    wrong = {where: found for where, found in looks.found.items() if found}
    text = (
        "axe-core against WCAG 2.2 AA and its best practices, everything unfolded, in "
        f"{len(looks.found)} states and screens: {', '.join(looks.found)}.\n\n"
        f"Violations: {sum(map(len, wrong.values()))} (limit 0).\n"
    )
    if wrong:
        text += "\n" + table(("state", "violation"), ((where, one) for where, found in wrong.items() for one in found))
    return Section(TITLE, text, not wrong)
