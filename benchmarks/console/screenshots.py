"""Pictures of the console: for the README, for comparisons, and of every state in every language to look through.

usage: python -m benchmarks.console.screenshots [--every FOLDER]

A whole procedure in the page. Without options it writes `docs/images/console*.webp`, among them an animation, and the
small pictures with which `tests/e2e/test_console.py` compares how the page looks.
"""

import argparse
import io
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from PIL import Image
from playwright.sync_api import Page

from benchmarks.common.operating_room import OperatingRoom, running
from benchmarks.common.places import ROOT
from benchmarks.console.browser import Screen, browser, new_context, sign_in, start_page
from benchmarks.console.looks import keep, look_of
from benchmarks.console.operator import ConsoleOperator
from distalock.installation import Installation, Ports
from services.ui_api.core.access_settings import DEMO_USER
from shared.arguments import OneLineParser

IMAGES: Final = ROOT / "docs" / "images"
LOOKS: Final = ROOT / "tests" / "e2e" / "looks"
LANGUAGES: Final = ("de", "zh", "en")
SCREENS: Final = (Screen(1920, 1080), Screen(1280, 800), Screen(3840, 2160))
_SEED: Final = "2"
_FRAME_PX: Final = (960, 600)
_FRAME_MS: Final = 1_600
_MOVING_FRAME_MS: Final = 250
# States that the README shows.
_STILLS: Final = {"approval: approve_plan": "console-approval", "drilling: drilled": "console-verified"}
SETTLED_MS: Final = 1_500.0


class Film:
    """An animation, frame by frame."""

    def __init__(self) -> None:
        self._frames: list[Image.Image] = []
        self._lasts_ms: list[int] = []

    def take(self, page: Page, lasts_ms: int = _FRAME_MS) -> None:
        """One frame of the page now."""
        self._frames.append(_picture(page).resize(_FRAME_PX, Image.Resampling.LANCZOS))
        self._lasts_ms.append(lasts_ms)

    def save(self, file: Path) -> None:
        """As an animated WebP that begins anew at its end."""
        first, *others = self._frames
        first.save(file, save_all=True, append_images=others, duration=self._lasts_ms, loop=0, quality=60, method=6)


def _picture(page: Page) -> Image.Image:
    return Image.open(io.BytesIO(page.screenshot())).convert("RGB")


def take_pictures(arguments: Sequence[str]) -> int:
    """Take the pictures; exit code 0."""
    parser = OneLineParser(prog="python -m benchmarks.console.screenshots", description="pictures of the console")
    parser.add_argument("--every", type=Path, help="folder for every state in every language and three sizes")
    given: argparse.Namespace = parser.parse_args(list(arguments))
    with _signed_in_page() as (page, site):
        operator = ConsoleOperator(page, site.installation.token)
        if given.every is not None:
            given.every.mkdir(parents=True, exist_ok=True)
            _every_state(page, operator, given.every)
        else:
            LOOKS.mkdir(exist_ok=True)
            _readme(page, operator)
    return 0


@contextmanager
def _signed_in_page() -> Iterator[tuple[Page, OperatingRoom]]:
    with tempfile.TemporaryDirectory() as folder:
        installation = Installation(Ports.any_free(), Path(folder), scenario_arguments=("--seed", _SEED))
        with running(installation) as site, browser() as chromium, new_context(chromium) as context:
            page = context.new_page()
            start_page(page, installation.ports.rest_url)
            page.wait_for_selector(".login")
            sign_in(page, installation.ports.rest_url, DEMO_USER, installation.token)
            page.wait_for_selector("text=The virtual room proposes")
            yield page, site


def _readme(page: Page, operator: ConsoleOperator) -> None:
    film = Film()
    film.take(page)
    keep(look_of(page), LOOKS / "no-case.png")
    for state in operator.states():
        _settle(page)
        if state in _STILLS:
            _picture(page).save(IMAGES / f"{_STILLS[state]}.webp", quality=80, method=6)
        film.take(page)
        if state == "motion: start_motion":
            _film_motion(page, operator, film)
    film.save(IMAGES / "console.webp")


def _film_motion(page: Page, operator: ConsoleOperator, film: Film) -> None:
    operator.press_and_hold()
    page.wait_for_selector(".hold-button.moving")
    while page.locator(".hold-button.moving").count() > 0:
        film.take(page, _MOVING_FRAME_MS)
    page.mouse.up()


def _settle(page: Page) -> None:
    """Until what came last is drawn, and the planned motion is well on its way."""
    page.wait_for_timeout(SETTLED_MS)


def _every_state(page: Page, operator: ConsoleOperator, folder: Path) -> None:
    _each_look(page, folder, "00-no-case")
    for number, state in enumerate(operator.states(), 1):
        _settle(page)
        _each_look(page, folder, f"{number:02d}-{state.replace(': ', '-')}")
    for place in ("cases", "users", "service"):
        page.evaluate(f"location.hash = '#/{place}'")
        _settle(page)
        _each_look(page, folder, f"90-{place}")
    page.evaluate("location.hash = '#/cases'")
    page.locator("table a").first.click()
    _settle(page)
    _each_look(page, folder, "95-record")


def _each_look(page: Page, folder: Path, name: str) -> None:
    for screen in SCREENS:
        page.set_viewport_size({"width": screen.width_px, "height": screen.height_px})
        for language in LANGUAGES:
            page.locator(".user-menu select").select_option(language)
            page.wait_for_timeout(300)
            page.screenshot(path=folder / f"{name}-{language}-{screen.width_px}.png")


if __name__ == "__main__":
    sys.exit(take_pictures(sys.argv[1:]))
