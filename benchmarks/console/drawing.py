"""Frames a second and the longest tasks while the picture and the scene are moved, without a graphics card."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from playwright.sync_api import Locator, Page

from benchmarks.common.operating_room import OperatingRoom
from benchmarks.console.browser import browser, new_context, sign_in
from benchmarks.console.operator import ConsoleOperator
from benchmarks.console.section import Section, table
from services.ui_api.core.access_settings import DEMO_USER

TITLE: Final = "Frames and tasks"
LEAST_FRAMES_PER_S: Final = 20.0
LONGEST_TASK_MS: Final = 100.0
_SECONDS: Final = 4.0
_MOVES_PER_S: Final = 60
_RUN_MS: Final = 6_000.0
# The last images of the run are on record and localised: a plan of an image that is no longer the newest is refused.
_SETTLES_MS: Final = 4_000.0
_WATCH: Final = """() => {
    globalThis.drawn = { frames: 0, tasks: [] };
    const frame = () => { drawn.frames++; requestAnimationFrame(frame); };
    requestAnimationFrame(frame);
    new PerformanceObserver((list) => list.getEntries().forEach((one) => drawn.tasks.push(one.duration)))
        .observe({ type: "longtask", buffered: false });
}"""


@dataclass(frozen=True, slots=True)
class Drawn:
    """What was seen during one thing that hands do.

    Attributes
    ----------
    longest_ms
        Longest task of the page's thread; those below 50 ms are not told apart.
    """

    name: str
    frames_per_s: float
    longest_ms: float


def measure(site: OperatingRoom) -> Section:
    """With a plan that waits for its approval: everything is drawn then."""
    with browser() as chromium, new_context(chromium) as context:
        page = context.new_page()
        sign_in(page, site.installation.ports.rest_url, DEMO_USER, site.installation.token)
        operator = ConsoleOperator(page, site.installation.token)
        operator.open_case()
        page.evaluate(_WATCH)
        operator.run_until(lambda one: (one.phase, one.next_action) == ("plan", "request_plan"))
        found = [Drawn("first image to overlay", math.nan, _longest_ms(page)), *_fluoroscopy(page, operator)]
        operator.run_until(lambda one: (one.phase, one.next_action) == ("approval", "approve_plan"))
        found += _all_hands(page)
        operator.abandon()
    return section_of(found)


def _fluoroscopy(page: Page, operator: ConsoleOperator) -> list[Drawn]:
    def run() -> None:
        operator.page.get_by_role("button", name="Hold for 5 s").click()
        page.wait_for_timeout(_RUN_MS)

    found = _during(page, "fluoroscopy, 10 images/s", run)
    page.wait_for_timeout(_SETTLES_MS)
    return [found]


def _all_hands(page: Page) -> list[Drawn]:
    picture, scene = page.locator(".pane .stage").first, page.locator(".scene-picture canvas")
    found = [_during(page, "planned motion plays", lambda: page.wait_for_timeout(1e3 * _SECONDS))]
    found.append(_during(page, "picture dragged", lambda: _drag(page, picture)))
    page.get_by_role("button", name="Brightness").click()
    found.append(_during(page, "window and level dragged", lambda: _drag(page, picture)))
    page.get_by_role("button", name="Hide", exact=True).first.click()
    found.append(_during(page, "scene turned", lambda: _drag(page, scene)))
    page.locator(".scene-views").get_by_role("button", name="C-arm").click()
    found.append(_during(page, "scene with C-arm turned", lambda: _drag(page, scene)))
    return found


def _during(page: Page, name: str, act: Callable[[], None]) -> Drawn:
    page.wait_for_timeout(500)
    before = page.evaluate("drawn.tasks.length = 0, [drawn.frames, performance.now()]")
    act()
    after = page.evaluate("[drawn.frames, performance.now()]")
    seconds = (after[1] - before[1]) / 1e3
    return Drawn(name, (after[0] - before[0]) / seconds, _longest_ms(page))


def _longest_ms(page: Page) -> float:
    return float(page.evaluate("Math.max(0, ...drawn.tasks)"))


def _drag(page: Page, where: Locator) -> None:
    """To and fro over a place, as a finger moves."""
    box = where.bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    for step in range(int(_SECONDS * _MOVES_PER_S)):
        angle = 2.0 * math.pi * step / _MOVES_PER_S
        page.mouse.move(x + 0.2 * box["width"] * math.sin(angle), y + 0.1 * box["height"] * math.sin(2 * angle))
        page.wait_for_timeout(1e3 / _MOVES_PER_S)
    page.mouse.up()


def section_of(found: list[Drawn]) -> Section:
    """A row for each."""
    rows = [
        (
            one.name,
            "-" if math.isnan(one.frames_per_s) else f"{one.frames_per_s:.0f}",
            f"{one.longest_ms:.0f} ms" if one.longest_ms > 0 else "below 50 ms",
        )
        for one in found
    ]
    text = (
        f"At 1280 x 800, drawn by the processor. Limits: at least {LEAST_FRAMES_PER_S:.0f} frames a second, no "
        f"task of the page's thread over {LONGEST_TASK_MS:.0f} ms.\n\n"
        + table(("meanwhile", "frames/s", "longest task"), rows)
    )
    holds = all(
        (math.isnan(one.frames_per_s) or one.frames_per_s >= LEAST_FRAMES_PER_S) and one.longest_ms <= LONGEST_TASK_MS
        for one in found
    )
    return Section(TITLE, text, holds)
