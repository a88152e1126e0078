"""A person at the console: reads what is next, and does it with mouse and keys in the page. Nothing but the page."""

import re
import time
from collections.abc import Callable
from typing import Final

from playwright.sync_api import Locator, Page

_PATIENCE_S: Final = 300.0
_MOST_ACTS: Final = 60
_CLOSED: Final = "closed"


class ConsoleOperator:
    """Does the procedure in the page of a simulation, whose virtual room is in the page too.

    Parameters
    ----------
    password
        For the approval.
    """

    def __init__(self, page: Page, password: str) -> None:
        self.page, self._password = page, password
        self.acts: list[str] = []
        self._tried_turn = False

    @property
    def phase(self) -> str:
        """Where the case is, as the page shows it."""
        return self._panel.get_attribute("data-phase") or ""

    @property
    def next_action(self) -> str:
        """What the page asks for; empty where there is to wait."""
        return self._panel.get_attribute("data-next") or ""

    @property
    def _panel(self) -> Locator:
        return self.page.locator(".procedure")

    def open_case(self) -> None:
        """Open the case that the virtual room proposes."""
        self.page.wait_for_selector("text=The virtual room proposes")
        self.page.get_by_role("button", name="Open a case").click()
        self._panel.wait_for()

    def run_until(self, reached: Callable[["ConsoleOperator"], bool]) -> None:
        """Do what is next, again and again, until the page shows what is wanted.

        Raises
        ------
        AssertionError
            When the procedure does not get there: with what the page says then.
        """
        for _ in range(_MOST_ACTS):
            if reached(self):
                return
            self.act()
        raise AssertionError(f"not reached after {self.acts}; the page says: {self._panel.inner_text()}")

    def finish(self) -> None:
        """The whole procedure, to the case's end."""
        self.run_until(lambda one: one.page.locator(".no-case").count() > 0)

    def act(self) -> None:
        """Do what is next, and wait until the page asks for something else."""
        wanted, before = self.next_action, self._said()
        self.acts.append(wanted)
        self._do(wanted)
        self._wait(lambda: self._said() != before or self.page.locator(".no-case").count() > 0, f"after {wanted}")

    def _do(self, wanted: str) -> None:
        doing: dict[str, Callable[[], None]] = {
            "acknowledge_stop": lambda: self._click("Acknowledge the stop"),
            "reference": self._reference,
            "take_image": self.take_image,
            "request_plan": lambda: self._click("Plan the move"),
            "approve_plan": self.approve,
            "start_motion": self.hold,
            "verify": lambda: self._click("Verify the guide"),
            "drilled": self._drill,
            "robot_removed": lambda: self._record("Robot taken off"),
            "screws_inserted": lambda: self._record("Screws inserted"),
            "finished": lambda: self._record("Finish the case"),
        }
        if wanted in doing:  # otherwise there is to wait
            doing[wanted]()

    def _reference(self) -> None:
        self._click("Reference the robot")
        self._click("Yes, do it")

    def approve(self) -> None:
        """The two acts, and the credential."""
        self._click(re.compile("^1 · "))
        self.page.fill("[name=credential]", self._password)
        self._click(re.compile("^2 · "))

    def hold(self) -> None:
        """Hold the button until the robot has reached its target."""
        self.press_and_hold()
        self._wait(lambda: self.page.locator(".hold-end.succeeded").count() > 0, "while the robot moves")
        self.page.mouse.up()

    def press_and_hold(self) -> None:
        """Press the button that moves, and do not let go."""
        button = self.page.locator(".hold-button")
        button.scroll_into_view_if_needed()
        button.hover()
        self.page.mouse.down()

    def take_image(self) -> None:
        """Step on the pedal; once, where the image before was rejected, turn the C-arm as advised first."""
        turn = self.page.get_by_role("button", name="Turn as advised")
        if self.phase == "alignment" and turn.count() > 0 and not self._tried_turn:
            self._tried_turn = True
            turn.click()
        self._room("Take one image")

    def _drill(self) -> None:
        drilled = (self.page.locator(".virtual-room").inner_text() or "").count("passed")
        holes = self.page.get_by_role("button", name=re.compile("^Drill (?!inserted)"))
        hole = holes.nth(min(drilled, holes.count() - 1))
        name = (hole.inner_text() or "").removeprefix("Drill ")
        hole.click()
        self._record("Drilled, and the drill is out", name)

    def _record(self, step: str, hole: str | None = None) -> None:
        row = self.page.get_by_role("button", name=step, exact=True)
        if row.get_attribute("aria-expanded") != "true":
            row.click()
        if hole is not None:
            self.page.locator(".step-form").get_by_role("checkbox", name=hole).check()
        self._click(f"Record: {step}")

    def _room(self, name: str) -> None:
        button = self.page.get_by_role("button", name=name, exact=True)
        button.click()
        # The page lets go of it when the room has answered.
        self._wait(button.is_enabled, f"the virtual room: {name}")

    def _click(self, name: str | re.Pattern[str]) -> None:
        self.page.get_by_role("button", name=name).first.click()

    def _said(self) -> tuple[str, str, str]:
        if self._panel.count() == 0:
            return "", "", ""
        return self.phase, self.next_action, self.page.locator(".next").inner_text()

    def _wait(self, holds: Callable[[], bool], what: str) -> None:
        until = time.monotonic() + _PATIENCE_S
        while not holds():
            problem = self.page.locator(".procedure .problem")
            if problem.count() > 0:
                raise AssertionError(f"refused {what}: {problem.first.inner_text()}")
            if time.monotonic() > until:
                raise AssertionError(f"nothing happened {what}; the page says: {self.page.inner_text('body')[:3000]}")
            self.page.wait_for_timeout(50)
