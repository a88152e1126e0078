"""A person at the console: reads what is next, and does it with mouse and keys in the page. Nothing but the page."""

import re
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Final

from playwright.sync_api import Locator, Page, Response
from playwright.sync_api import TimeoutError as NotThereInTime

_PATIENCE_S: Final = 300.0
_ADVICE_STANDS_S: Final = 5.0
_MOST_ACTS: Final = 60
# Of the virtual room's own API all but what the panel reads by itself.
_HANDS: Final = "/virtual-room/"
_ENDED: Final = ".hold-end:is(.succeeded, .stopped, .failed, .refused)"
# Together, because the procedure may be closed between two questions.
_SAID: Final = """() => {
    const panel = document.querySelector(".procedure");
    return panel && [panel.dataset.phase, panel.dataset.next, panel.querySelector(".next").innerText];
}"""


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
        self.drilled: list[str] = []
        self._tried_turn = False

    @property
    def phase(self) -> str:
        """Where the case is, as the page shows it."""
        return self._said()[0]

    @property
    def next_action(self) -> str:
        """What the page asks for; empty where there is to wait."""
        return self._said()[1]

    @property
    def sentence(self) -> str:
        """What stands under *Next*."""
        return self._said()[2]

    @property
    def _panel(self) -> Locator:
        return self.page.locator(".procedure")

    def open_case(self, side: str | None = None) -> None:
        """Open the case that the virtual room proposes, or the same of another side."""
        self.page.wait_for_selector("text=The virtual room proposes")
        if side is not None:
            self.choose_side(side)
        self.page.get_by_role("button", name="Open a case").click()
        self._panel.wait_for()

    def choose_side(self, side: str) -> None:
        """Choose the side of the body in the form that shows."""
        self.page.locator(".set-up").get_by_role("radio", name=side.upper(), exact=True).check()

    def change_side(self, side: str) -> None:
        """Correct the side of the open case."""
        self.choose_side(side)
        self.page.locator(".set-up").get_by_role("button", name="Change the set-up").click()

    def inject(self, fault: str) -> None:
        """Switch a fault of the virtual room on, by the name that the page gives it."""
        self.page.locator(".virtual-room select").select_option(label=fault)
        self.room("Switch on")

    def clear_faults(self) -> None:
        """Switch all faults off."""
        self.room("Clear all")

    def record(self, step: str, hole: str | None = None) -> None:
        """Record a step that is in order; its form has closed when this returns."""
        row = self.page.get_by_role("button", name=step, exact=True)
        if row.get_attribute("aria-expanded") != "true":
            row.click()
        if hole is not None:
            self.page.locator(".step-form").get_by_role("checkbox", name=hole).check()
        self._click(f"Record: {step}")
        # It stays until all of the case was read anew, which may be after the page asks for what is next.
        self._wait(lambda: self.page.locator(".step-form").count() == 0, f"while {step!r} is recorded")

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
        raise AssertionError(f"not reached after {self.acts}; {self._page_says()}")

    def states(self) -> Iterator[str]:
        """Open a case and do the whole procedure, with a pause in each state for whoever iterates.

        Yields
        ------
        str
            Phase and what is next.
        """
        self.open_case()
        while (said := self._said())[0]:
            if said[1]:
                yield f"{said[0]}: {said[1]}"
            self.act()

    def abandon(self) -> None:
        """End the case."""
        self.record("Abandon the case")
        self.page.wait_for_selector(".no-case")

    def finish(self) -> None:
        """The whole procedure, to the case's end."""
        self.run_until(lambda one: one.page.locator(".no-case").count() > 0)

    def act(self) -> None:
        """Do what is next, and wait until the page asks for something else."""
        before = self._said()
        wanted = before[1]  # of the same look: what is next may change between two
        self.acts.append(wanted)
        self._do(wanted)
        self._wait(lambda: self._said() != before or self.page.locator(".no-case").count() > 0, f"after {wanted}")

    def _do(self, wanted: str) -> None:
        doing: dict[str, Callable[[], None]] = {
            "acknowledge_stop": lambda: self._click("Acknowledge the stop"),
            "reference": lambda: self._click_twice("Reference the robot"),
            # A machine that is too busy answers the robot too late, which is a fault.
            "reset": lambda: self._click_twice("Reset the robot"),
            "take_image": self.take_image,
            "request_plan": lambda: self._click("Plan the move"),
            "approve_plan": self.approve,
            "start_motion": self.hold,
            "verify": lambda: self._click("Verify the guide"),
            "drilled": self._drill,
            "robot_removed": lambda: self.record("Robot taken off"),
            "screws_inserted": lambda: self.record("Screws inserted"),
            "finished": lambda: self.record("Finish the case"),
        }
        if wanted in doing:  # otherwise there is to wait
            doing[wanted]()

    def _click_twice(self, name: str) -> None:
        self._click(name)
        self._click("Yes, do it")

    def approve(self) -> None:
        """The two acts, and the credential."""
        self._click(re.compile("^1 · "))
        self.page.fill("[name=credential]", self._password)
        self._click(re.compile("^2 · "))

    def hold(self) -> None:
        """Hold the button until the motion has ended: at its target, unless this machine is too busy to hold it."""
        self.press_and_hold()
        self._wait(lambda: self.page.locator(_ENDED).count() > 0, "while the robot moves")
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
            with suppress(NotThereInTime):  # advice goes with the image that it is for, when a newer one is localised
                self.room("Turn as advised", _ADVICE_STANDS_S)
        self.room("Take one image")

    def _drill(self) -> None:
        holes = self.page.locator(".virtual-room").get_by_role("button", name=re.compile("^Drill ")).all_inner_texts()
        name = next(text.removeprefix("Drill ") for text in holes if text not in self.drilled)
        self.room(f"Drill {name}")
        self.drilled.append(f"Drill {name}")
        self.record("Drilled, and the drill is out", name)

    def room(self, name: str, within_s: float = _PATIENCE_S) -> None:
        """Something that hands do; the virtual room has answered when this returns."""
        button = self.page.locator(".virtual-room").get_by_role("button", name=name, exact=True)
        with self.page.expect_response(_is_of_hands) as answer:
            button.click(timeout=1e3 * within_s)
        if not answer.value.ok:
            raise AssertionError(f"the virtual room, {name}: {answer.value.text()}")

    def _click(self, name: str | re.Pattern[str]) -> None:
        self.page.get_by_role("button", name=name).first.click()

    def _said(self) -> tuple[str, str, str]:
        phase, wanted, sentence = self.page.evaluate(_SAID) or ("", "", "")
        return phase, wanted, sentence

    def _wait(self, holds: Callable[[], bool], what: str) -> None:
        until = time.monotonic() + _PATIENCE_S
        while not holds():
            problem = self.page.locator(".procedure .problem")
            if problem.count() > 0:
                raise AssertionError(f"refused {what}: {problem.first.inner_text()}")
            if time.monotonic() > until:
                raise AssertionError(f"nothing happened {what}; {self._page_says()}")
            self.page.wait_for_timeout(50)

    def _page_says(self) -> str:
        return f"the page says: {self.page.inner_text('body')[:3000]}"


def _is_of_hands(response: Response) -> bool:
    return _HANDS in response.url and response.request.method != "GET"
