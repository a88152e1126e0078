"""The console in a real browser: a whole procedure from the page alone, use errors, and axe on every screen.

One installation and one Chromium serve all of it; a case is closed before the next begins.
"""

import json
import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

import pytest
from playwright.sync_api import Browser, Page, Request, Route

from benchmarks.common.operating_room import OperatingRoom
from benchmarks.console.accessibility import violations
from benchmarks.console.browser import NO_CHROMIUM, browser, chromium_path, new_context, sign_in
from benchmarks.console.looks import LARGEST_DIFFERENCE, difference, kept, look_of
from benchmarks.console.operator import ConsoleOperator
from benchmarks.console.screenshots import LOOKS, SETTLED_MS
from services.ui_api.core.access_settings import DEMO_USER

# CI sets it where it has a Chromium: then a test that does not find it fails.
_REQUIRED: Final = "CHROMIUM_REQUIRED"
pytestmark = [
    pytest.mark.skipif(chromium_path() is None and _REQUIRED not in os.environ, reason=NO_CHROMIUM),
    pytest.mark.slow,
    pytest.mark.timeout(1200),
]

SURGEON: Final = "s.urgeon"
PASSWORD: Final = "four words of the console"

# As far as a person pushes the mount: three seconds more of a way on which a hand can let go, also on a slow machine.
PUSHED_MM: Final = (6.0, 0.0, 0.0)

# Each with a stream of its own, they would take all connections of the browser.
TABS: Final = 6

LOOKED_AT: Final = ("approval: approve_plan", "drilling: drilled")
# What the page promises: that a gateway is gone is said within 2 s.
SAID_WITHIN_S = 2.0
# Ten years behind.
SLOW_CLOCK = """{
    const Right = Date, now = () => Right.now() - 3.15e11;
    globalThis.Date = class extends Right {
        static now = now;
        constructor(...given) { super(...(given.length > 0 ? given : [now()])); }
    };
}"""

# The list of images comes long after what is next does.
SLOW_READS = """() => {
    const right = globalThis.fetch, isSlow = (asked) => asked.method === "GET" && asked.url.includes("/images?");
    globalThis.fetch = async (asked, how) => {
        if (isSlow(asked)) await new Promise((done) => setTimeout(done, 2_000));
        return right(asked, how);
    };
}"""


@pytest.fixture(scope="module")
def chromium(site: OperatingRoom) -> Iterator[Browser]:
    with browser() as launched:
        yield launched


@pytest.fixture
def page(chromium: Browser, site: OperatingRoom) -> Iterator[Page]:
    with _signed_in(chromium, site, DEMO_USER, site.installation.token) as opened:
        yield opened


@pytest.fixture
def page_of_surgeon(chromium: Browser, site: OperatingRoom) -> Iterator[Page]:
    """The page of an account: the simulation's user needs no credential to approve, and can have no passkey."""
    site.rest.post("/api/v1/users", {"name": SURGEON, "password": PASSWORD, "roles": ["surgeon"]})
    with _signed_in(chromium, site, SURGEON, PASSWORD) as opened:
        yield opened


@contextmanager
def _signed_in(chromium: Browser, site: OperatingRoom, name: str, password: str) -> Iterator[Page]:
    with new_context(chromium) as context:
        opened = context.new_page()
        wrong: list[str] = []
        opened.on("pageerror", lambda error: wrong.append(str(error)))
        sign_in(opened, _url(site), name, password)
        yield opened
        assert wrong == [], "scripts of the page failed"


def _url(site: OperatingRoom) -> str:
    """By the machine's name, to which passkeys are bound."""
    return site.installation.ports.rest_url.replace("127.0.0.1", "localhost")


def _reach(operator: ConsoleOperator, phase: str, action: str) -> None:
    operator.run_until(lambda one: (one.phase, one.next_action) == (phase, action))


def test_a_whole_procedure_from_the_page_alone(page: Page, site: OperatingRoom) -> None:
    operator = ConsoleOperator(page, site.installation.token)
    page.wait_for_selector("text=SIMULATION")
    page.wait_for_selector("text=The virtual room proposes")
    _looks_as_kept(page, "no-case")
    assert violations(page) == []
    for state in operator.states():
        if state in LOOKED_AT:
            page.wait_for_selector(".overlay .hole .axis", state="attached")
        if state == "drilling: drilled" and not operator.drilled:
            page.evaluate(SLOW_READS)
    assert {"approve_plan", "start_motion", "verify", "drilled", "finished"} <= set(operator.acts)
    drills = site.control.get("/drills")["items"]
    assert isinstance(drills, list)
    assert [drill["passed"] for drill in drills] == [True, True]


def _looks_as_kept(page: Page, name: str) -> None:
    page.wait_for_timeout(SETTLED_MS)
    apart = difference(look_of(page), kept(LOOKS / f"{name}.png"))
    assert apart <= LARGEST_DIFFERENCE, (
        f"{name} looks otherwise, by {apart:.0f} of 255 in one place; if it is to, run `make screenshots`"
    )


@pytest.mark.parametrize("place", ["cases", "users", "service"])
def test_other_screens_have_no_violation(page: Page, place: str) -> None:
    page.goto(f"{page.url.split('#')[0]}#/{place}")
    page.wait_for_selector(".page-view h1")
    page.wait_for_selector(".page-view :is(form, td, .empty)")
    assert violations(page) == []


def test_the_record_of_a_case_has_its_timeline_and_prints_light(page: Page, site: OperatingRoom) -> None:
    newest = site.gateway.list_cases(sort="newest", limit=1).items
    assert newest, "the procedure's test opened one"
    page.goto(f"{page.url.split('#')[0]}#/cases/{newest[0].id}")
    page.wait_for_selector(".timeline li img")
    page.wait_for_selector(".bars")
    assert violations(page) == []
    page.emulate_media(media="print")
    assert not page.locator(".stop").is_visible()
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"


def test_a_gateway_that_is_gone_is_said_and_comes_back_by_itself(page: Page) -> None:
    def gone(route: Route) -> None:
        route.abort("connectionrefused")

    page.wait_for_selector(".connection.live")
    page.route("**/api/**", gone)
    page.wait_for_selector(".connection.lost", timeout=1e3 * SAID_WITHIN_S)
    assert page.locator(".robot:not(.not-live)").count() == 0, "the robot's state is shown as live"
    assert violations(page) == []
    page.unroute("**/api/**")
    page.wait_for_selector(".connection.live")


def test_a_stop_goes_out_by_key_and_by_finger_and_is_said_when_it_was_not_confirmed(page: Page) -> None:
    sent: list[str] = []
    page.on("request", lambda request: sent.append(request.method) if request.url.endswith("/robot/stop") else None)
    page.keyboard.press("Escape")
    page.wait_for_selector(".stop-state.confirmed")
    page.locator(".stop-button").click()
    page.wait_for_selector(".stop-state.confirmed")
    assert sent == ["POST", "POST"]
    problem = json.dumps({"code": "stop_not_confirmed", "detail": "nothing is known"})
    page.route("**/robot/stop", lambda route: route.fulfill(status=504, body=problem, content_type="application/json"))
    page.locator(".stop-button").click()
    page.wait_for_selector("text=NOT CONFIRMED")
    page.wait_for_selector("text=HIGH PRIORITY")


def test_tabs_of_one_browser_share_a_stream_of_events_and_each_can_stop(page: Page) -> None:
    def is_stream(request: Request) -> bool:
        return request.url.endswith("/api/v1/events")

    context, streams = page.context, list[Request]()
    page.wait_for_selector(".connection.live")
    context.on("request", lambda request: streams.append(request) if is_stream(request) else None)
    others = [context.new_page() for _ in range(TABS - 1)]
    for other in others:
        other.goto(page.url)
        other.wait_for_selector(".connection.live")
    others[-1].locator(".stop-button").click()
    others[-1].wait_for_selector(".stop-state.confirmed")
    assert streams == [], "each stream holds one of the browser's six connections"
    with context.expect_event("request", is_stream):  # another tab goes on
        page.close()


def test_the_page_keeps_nothing_that_identifies_a_patient(page: Page) -> None:
    kept = page.evaluate("JSON.stringify([{...localStorage}, {...sessionStorage}])")
    assert set(json.loads(kept)[0]) <= {"distalock-language"}
    assert json.loads(kept)[1] == {}


def test_a_clock_of_the_page_that_is_wrong_changes_no_age(page: Page) -> None:
    page.add_init_script(SLOW_CLOCK)
    page.reload()
    assert page.evaluate("new Date().getFullYear()") < 2020
    page.wait_for_selector(".connection.live")
    age = page.locator(".robot h2 small").inner_text()
    assert float(age.split()[0]) < 60


def test_use_errors(page_of_surgeon: Page, site: OperatingRoom) -> None:
    """One case, because an installation has one at a time; each part leaves it so that it can go on."""
    page, operator = page_of_surgeon, ConsoleOperator(page_of_surgeon, PASSWORD)
    has_drilled = bool(site.control.get("/drills")["items"])
    _a_wrong_side_is_noticed_and_corrected(operator, site)
    _an_image_without_the_guide_is_refused(operator)
    # A case before has left the guide where it belongs: what is to be interrupted needs a way.
    if has_drilled:
        _push_mount(site)
    _reach(operator, "plan", "request_plan")
    _who_has_not_seen_what_another_did_plans_nothing(operator)
    _reach(operator, "approval", "approve_plan")
    _an_approval_needs_both_acts_and_the_right_credential(page)
    _a_session_that_ends_during_approval_approves_nothing(page)
    _reach(operator, "motion", "start_motion")
    _a_reload_shows_the_same(operator)
    _a_double_tap_moves_nothing(page)
    _letting_go_stops(operator, site)
    _push_mount(site)  # each further motion is to be interrupted before it reaches the target
    _reach(operator, "approval", "approve_plan")
    _a_passkey_approves(operator)
    _the_stop_is_stronger_than_the_hand_that_holds(operator, site)
    _push_mount(site)
    _reach(operator, "motion", "start_motion")
    _a_connection_that_is_lost_in_motion_stops_and_is_said(operator, site)
    operator.abandon()


def _push_mount(site: OperatingRoom) -> None:
    site.control.post("/faults", {"kind": "mount_shift", "shift_mm": PUSHED_MM})


def _a_wrong_side_is_noticed_and_corrected(operator: ConsoleOperator, site: OperatingRoom) -> None:
    right = str(site.room.scenario().set_up["side"])
    operator.open_case(side="left" if right == "right" else "right")
    operator.room("New bone, nothing drilled")
    _reach(operator, "localisation", "change_setup")
    assert f"header states the {right} side" in operator.sentence
    operator.change_side(right)
    operator.page.wait_for_selector(f".case-line .side:has-text('{right.upper()}')")


def _an_image_without_the_guide_is_refused(operator: ConsoleOperator) -> None:
    operator.inject("no guide")
    operator.room("Take one image")
    operator.page.wait_for_selector(".procedure[data-phase=mounting][data-next=take_image]")
    operator.clear_faults()


def _who_has_not_seen_what_another_did_plans_nothing(operator: ConsoleOperator) -> None:
    """Two tabs: the mount has moved in one, and the other did not hear of it."""
    page, path = operator.page, re.compile("/api/v1/cases")
    page.route(path, lambda route: route.abort() if route.request.method == "GET" else route.continue_())
    with page.context.expect_page() as opening:
        page.evaluate("window.open(location.href, '_blank')")
    other = ConsoleOperator(opening.value, "")
    other.page.wait_for_selector(".procedure[data-next=request_plan]")
    other.record("The mount has moved")
    other.page.wait_for_selector(".procedure[data-next=take_image]")
    other.page.wait_for_selector(".image-status .stale-result")
    other.page.close()
    assert operator.next_action == "request_plan"
    page.get_by_role("button", name="Plan the move").click()
    page.wait_for_selector(".problem:has-text('Look at it again')")
    page.unroute(path)
    page.wait_for_selector(".procedure[data-next=take_image]")


def _a_reload_shows_the_same(operator: ConsoleOperator) -> None:
    said = (operator.phase, operator.next_action)
    operator.page.reload()
    operator.page.wait_for_selector(".procedure")
    assert (operator.phase, operator.next_action) == said


def _an_approval_needs_both_acts_and_the_right_credential(page: Page) -> None:
    assert page.locator("[name=credential]").count() == 0, "the credential is asked for before the plan was checked"
    assert violations(page) == []
    page.get_by_role("button", name=re.compile("^1 · ")).click()
    page.fill("[name=credential]", "not the password")
    page.get_by_role("button", name=re.compile("^2 · ")).click()
    page.wait_for_selector("text=he password is not that of")


def _a_session_that_ends_during_approval_approves_nothing(page: Page) -> None:
    page.fill("[name=credential]", PASSWORD)
    page.context.clear_cookies()
    # Without anything being pressed: what the page reads by itself is refused.
    page.wait_for_selector("text=The session has ended")
    assert violations(page) == []
    page.fill("[name=name]", SURGEON)
    page.fill("[name=password]", PASSWORD)
    page.get_by_role("button", name="Sign in").click()
    page.wait_for_selector(".procedure[data-next=approve_plan]")
    assert page.locator("[name=credential]").count() == 0, "the plan is looked at again"


def _a_passkey_approves(operator: ConsoleOperator) -> None:
    page = operator.page
    authenticator = page.context.new_cdp_session(page)
    authenticator.send("WebAuthn.enable")
    finger = {"protocol": "ctap2", "transport": "internal", "hasUserVerification": True, "isUserVerified": True}
    authenticator.send("WebAuthn.addVirtualAuthenticator", {"options": finger})
    page.evaluate("location.hash = '#/users'")
    page.fill("[name=label]", "this machine")
    page.fill("[name=passkey-password]", PASSWORD)
    page.get_by_role("button", name="Register a passkey").click()
    page.wait_for_selector(".passkeys li:has-text('this machine')")
    assert violations(page) == []
    page.evaluate("location.hash = '#/'")
    page.get_by_role("button", name=re.compile("^1 · ")).click()
    page.get_by_role("button", name="Approve with the passkey").click()
    page.wait_for_selector(".procedure[data-next=start_motion]")


def _a_double_tap_moves_nothing(page: Page) -> None:
    began: list[str] = []
    page.on("request", lambda request: began.append(request.url) if request.url.endswith("/motions") else None)
    page.locator(".hold-button").dblclick()
    page.wait_for_timeout(1_000)
    assert began == []
    assert page.locator(".procedure").get_attribute("data-next") == "start_motion"


def _letting_go_stops(operator: ConsoleOperator, site: OperatingRoom) -> None:
    _move(operator)
    operator.page.mouse.up()
    operator.page.wait_for_selector(".hold-end.stopped")
    assert _state(site)["locked"] is True


def _the_stop_is_stronger_than_the_hand_that_holds(operator: ConsoleOperator, site: OperatingRoom) -> None:
    _move(operator)
    operator.page.keyboard.press("Escape")
    operator.page.wait_for_selector(".stop-state.confirmed")
    operator.page.wait_for_selector(".hold-end.stopped")  # the robot confirms a stop before its next state is published
    assert _state(site)["locked"] is True
    assert violations(operator.page) == []
    operator.page.mouse.up()
    # until the page has read the case anew, it offers the motion that was stopped
    operator.page.wait_for_selector(".procedure:not([data-next=start_motion])")


def _a_connection_that_is_lost_in_motion_stops_and_is_said(operator: ConsoleOperator, site: OperatingRoom) -> None:
    page = operator.page
    _move(operator)
    page.wait_for_selector(".robot .lamp.moving")
    lost_s = time.monotonic()
    page.context.set_offline(True)
    page.wait_for_selector(".connection.lost")
    page.wait_for_selector(".alarm.high")
    assert time.monotonic() - lost_s <= SAID_WITHIN_S
    assert page.locator(".robot:not(.not-live)").count() == 0, "the robot's state is shown as live"
    assert violations(page) == []
    page.context.set_offline(False)
    page.wait_for_selector(".connection.live")
    page.wait_for_selector(".hold-end.stopped")
    assert _state(site)["locked"] is True
    page.mouse.up()


def _move(operator: ConsoleOperator) -> None:
    operator.press_and_hold()
    operator.page.wait_for_selector(".hold-button.moving")


def _state(site: OperatingRoom) -> dict[str, object]:
    state = site.rest.get("/api/v1/robot")["state"]
    assert isinstance(state, dict)
    return state
