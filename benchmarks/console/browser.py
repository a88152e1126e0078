"""A Chromium of this machine, and a page of the console in it."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

from playwright.sync_api import Browser, BrowserContext, Page, sync_playwright

NO_CHROMIUM: Final = "there is no chromium on PATH; install Debian's package chromium, or set CHROMIUM to its file"
_NAMES: Final = ("chromium", "chromium-browser", "google-chrome")
# It speaks to nobody but the gateway. `swiftshader`: 3-D without a graphics card.
_ARGUMENTS: Final = ("--no-sandbox", "--disable-background-networking", "--enable-unsafe-swiftshader")
# No limit of the page's: a machine that is busy otherwise is slow.
_PATIENCE_MS: Final = 120_000


@dataclass(frozen=True, slots=True)
class Screen:
    """Size of the page in CSS pixels."""

    width_px: int = 1280
    height_px: int = 800


_USUAL_SCREEN: Final = Screen()


def chromium_path() -> str | None:
    """Chromium's file; None where the machine has none."""
    return os.environ.get("CHROMIUM") or next((found for name in _NAMES if (found := shutil.which(name))), None)


@contextmanager
def browser() -> Iterator[Browser]:
    """A browser without a window."""
    path = chromium_path()
    if path is None:
        raise FileNotFoundError(NO_CHROMIUM)
    with sync_playwright() as playwright:
        launched = playwright.chromium.launch(executable_path=path, args=list(_ARGUMENTS))
        try:
            yield launched
        finally:
            launched.close()


def new_context(of: Browser, screen: Screen = _USUAL_SCREEN) -> BrowserContext:
    """A browser profile of its own, with nothing in it."""
    context = of.new_context(viewport={"width": screen.width_px, "height": screen.height_px}, locale="en-GB")
    context.set_default_timeout(_PATIENCE_MS)
    return context


def start_page(page: Page, url: str) -> None:
    """Load the console."""
    page.goto(f"{url}/")


def sign_in(page: Page, url: str, name: str, password: str) -> None:
    """Load the console and sign in."""
    start_page(page, url)
    page.fill("[name=name]", name)
    page.fill("[name=password]", password)
    page.get_by_role("button", name="Sign in").click()
    page.wait_for_selector(".head")
