"""A procedure that does not give up: it reaches each step from wherever a fault has left it, and keeps the refusals."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, TypeAlias

import httpx

from benchmarks.faults.acknowledged import AcknowledgingClient
from benchmarks.faults.case_actions import CaseActions
from benchmarks.faults.procedure_site import ProcedureSite
from distalock.client import RequestRefused
from distalock.robot_readiness import NotDone, make_robot_ready

NO_ANSWER: Final = "nobody answered"
_MOST_ATTEMPTS: Final = 12
_PATIENCE_S: Final = 300.0
_PAUSE_S: Final = 0.1
# As far as a person pushes; a way of more than a second.
_PUSH_MM: Final = 4.0
_SETBACKS: Final = (RequestRefused, NotDone, httpx.HTTPError, TimeoutError)


class Step(StrEnum):
    """How far the procedure is when a fault comes, in the order of the procedure."""

    IDLE = "no case"
    CASE_OPEN = "case open"
    IMAGE_TAKEN = "image taken"
    LOCALISED = "localised"
    PLANNED = "planned"
    APPROVED = "approved"
    MOVING = "moving"
    LOCKED = "locked"
    WIRED = "wires"


STEPS: Final = tuple(Step)
_Action: TypeAlias = Callable[[CaseActions, AcknowledgingClient], None]
_ACTIONS: Final[Mapping[Step, _Action]] = {
    Step.CASE_OPEN: CaseActions.open_and_prepare,
    Step.IMAGE_TAKEN: CaseActions.shoot,
    Step.LOCALISED: CaseActions.localise,
    Step.PLANNED: CaseActions.make_plan,
    Step.APPROVED: CaseActions.approve,
    Step.MOVING: CaseActions.begin_to_move,
    Step.LOCKED: CaseActions.finish_to_move,
    Step.WIRED: CaseActions.insert_wires,
}
# What takes no time to ask for.
_ASKED_AT_ONCE: Final[Mapping[Step, _Action]] = {
    Step.CASE_OPEN: CaseActions.open,
    Step.IMAGE_TAKEN: CaseActions.shoot,
    Step.PLANNED: CaseActions.make_plan,
    Step.APPROVED: CaseActions.approve,
    Step.MOVING: CaseActions.ask_to_move,
    Step.WIRED: CaseActions.insert_wires,
}


class Stuck(Exception):
    """The procedure does not go on; the message says what was refused last."""


@dataclass(slots=True)
class PatientProcedure:
    """One case after another on a site, from step to step.

    Attributes
    ----------
    at
        The last step that was reached.
    said
        What was refused on the way, in the order of time: why the procedure did not go on at once.
    """

    site: ProcedureSite
    rest: AcknowledgingClient
    actions: CaseActions = field(init=False)
    at: Step = Step.IDLE
    said: list[str] = field(default_factory=list)
    pushes: int = 0

    def __post_init__(self) -> None:
        self.actions = CaseActions(self.site)

    def reach(self, step: Step) -> None:
        """Go on to a step, beginning anew with the robot and an image where something was refused; raises `Stuck`."""
        deadline_s, attempts = time.monotonic() + _PATIENCE_S, 0
        while (ahead := _next_of(self.at)) and STEPS.index(self.at) < STEPS.index(step):
            if attempts >= _MOST_ATTEMPTS or time.monotonic() > deadline_s:
                raise Stuck(f"'{step}' was not reached from '{self.at}': {'; '.join(self.said[-3:])}")
            if not self._tried(ahead, _ACTIONS[ahead], self.rest):
                attempts += 1
                self._begin_anew()

    def require_motion(self) -> None:
        """Be in motion now: from where a fault let the motion end, on a new way; raises `Stuck`."""
        for _ in range(_MOST_ATTEMPTS):
            self.reach(Step.MOVING)
            if self.at is Step.MOVING and self.site.hexapod().moving:
                return
            self.push_mount()
            self.at = self._with_robot_ready()
        raise Stuck("no motion was under way when the fault was to come")

    def try_during_fault(self, rest: AcknowledgingClient) -> None:
        """Ask for the next thing once, where asking takes no time; what is refused is noted."""
        ahead = _next_of(self.at)
        if ahead is not None and ahead in _ASKED_AT_ONCE:
            self._tried(ahead, _ASKED_AT_ONCE[ahead], rest)

    def finish(self) -> None:
        """Verify with the wires, pull them and close the case; raises `Stuck`."""
        for _ in range(_MOST_ATTEMPTS):
            try:
                if self.at is Step.WIRED:
                    self.actions.verify(self.rest)
                self.actions.close(self.rest)
            except _SETBACKS as setback:
                self.said.append(f"verification: {_sentence(setback)}")
                time.sleep(_PAUSE_S)
                continue
            self.at = Step.IDLE
            return
        raise Stuck(f"the case could not be verified and closed: {'; '.join(self.said[-3:])}")

    def _tried(self, step: Step, action: _Action, rest: AcknowledgingClient) -> bool:
        try:
            action(self.actions, rest)
        except _SETBACKS as setback:
            self.said.append(f"{step}: {_sentence(setback)}")
            return False
        self.at = step
        return True

    def _begin_anew(self) -> None:
        """Where to go on after a refusal: with a robot that is ready and a new image, if anything is to be moved."""
        if self.at not in (Step.IDLE, Step.LOCKED, Step.WIRED):
            self.at = self._with_robot_ready()
        time.sleep(_PAUSE_S)

    def _with_robot_ready(self) -> Step:
        try:
            make_robot_ready(self.rest)
        except _SETBACKS as setback:
            self.said.append(f"robot: {_sentence(setback)}")
            return Step.IDLE
        return Step.CASE_OPEN

    def push_mount(self) -> None:
        """Somebody pushes the mount, there and back again, so that there is a way to go."""
        self.pushes += 1
        shift_mm = (_PUSH_MM * (self.pushes % 2), 0.0, 0.0)
        self.site.room.control.post("/faults", {"kind": "mount_shift", "shift_mm": shift_mm})


def _next_of(step: Step) -> Step | None:
    return next(iter(STEPS[STEPS.index(step) + 1 :]), None)


def _sentence(setback: Exception) -> str:
    if isinstance(setback, RequestRefused | NotDone):
        return str(setback)
    return f"{NO_ANSWER} ({type(setback).__name__})"
