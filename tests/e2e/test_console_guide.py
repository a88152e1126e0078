"""The console that docs/console-guide.md builds leads a case in Chromium, exactly as it stands on the page."""

import functools
import http.server
import re
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect, sync_playwright

from benchmarks.common.operating_room import OperatingRoom
from distalock.local_ports import free_ports
from tests.e2e.conftest import SEED, operating_room

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

GUIDE = Path(__file__).parents[2] / "docs" / "console-guide.md"
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
# An image is localised within a second, and within a minute on a busy machine.
PATIENCE_MS = 180_000.0


def write_console(folder: Path) -> None:
    """The page and its script, cut out of the guide."""
    guide = GUIDE.read_text(encoding="utf-8")
    (page,) = re.findall(r"```html\n(.*?)```", guide, re.DOTALL)
    (folder / "console.html").write_text(page, encoding="utf-8")
    (folder / "console.js").write_text("\n".join(re.findall(r"```js\n(.*?)```", guide, re.DOTALL)), encoding="utf-8")


@contextmanager
def served(folder: Path, port: int) -> Iterator[str]:
    """What `python3 -m http.server` does."""
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", port), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{port}"
        finally:
            server.shutdown()


@contextmanager
def browser_page() -> Iterator[Page]:
    """A page of Chromium that speaks to nobody else."""
    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", "--disable-background-networking"]
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=arguments)
        try:
            page = browser.new_page()
            page.set_default_timeout(PATIENCE_MS)
            yield page
        finally:
            browser.close()


def press(page: Page, name: str) -> None:
    """Press an action's button when it is there, and read that it is done."""
    page.locator(f'#actions button[name="{name}"]').click()
    expect(page.locator("#message")).to_have_text(f"{name}: done", timeout=PATIENCE_MS)


@pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium on this machine")
def test_the_guides_console_leads_a_case_to_the_aligned_guide(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (port,) = free_ports(1)
    folder = tmp_path / "page"
    folder.mkdir()
    write_console(folder)
    monkeypatch.setenv("DISTALOCK_UI_API_CORS_ORIGINS", f'["http://127.0.0.1:{port}"]')
    with (
        served(folder, port) as address,
        operating_room(tmp_path / "room", SEED) as site,
        browser_page() as page,
    ):
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(f"{address}/console.html")
        sign_in(page, site)
        lead(page, site)
        assert errors == []


def sign_in(page: Page, site: OperatingRoom) -> None:
    page.fill("[name=gateway]", site.installation.ports.rest_url)
    page.fill("[name=password]", "wrong")
    page.click("#login button")
    expect(page.locator("#message")).not_to_be_empty(timeout=PATIENCE_MS)
    page.fill("[name=password]", site.installation.token)
    page.click("#login button")
    expect(page.locator("#banner")).to_contain_text("SIMULATION", timeout=PATIENCE_MS)


def lead(page: Page, site: OperatingRoom) -> None:
    """Every button of the guide up to the aligned guide, and a stop."""
    press(page, "open_case")
    press(page, "acknowledge_stop")
    press(page, "reference")
    expect(page.locator("#robot")).to_have_text("locked (simulated)", timeout=PATIENCE_MS)
    page.wait_for_timeout(1500)  # an image that is taken sooner is bound to no pose
    site.room.take_shot()
    press(page, "request_plan")
    expect(page.locator("#image")).to_have_attribute("data-image", re.compile("[0-9a-f]{64}"), timeout=PATIENCE_MS)
    press(page, "approve_plan")
    press(page, "start_motion")
    page.click("#stop")
    expect(page.locator("#robot")).to_have_text("stopped (simulated)", timeout=PATIENCE_MS)
    (case,) = site.gateway.list_cases(status="open").items
    assert case.plans == 1
    assert len(case.motions) == 1
