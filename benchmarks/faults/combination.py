"""One fault at one step: inject, look, lift, look again, and hold what was seen against what must hold."""

import time
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final

import httpx

from benchmarks.faults.acknowledged import AcknowledgingClient
from benchmarks.faults.declaration import Fault, InMotion
from benchmarks.faults.judgement import wrong_in_answers, wrong_in_motion, wrong_in_readiness
from benchmarks.faults.patient import PatientProcedure, Step
from benchmarks.faults.site import FaultSite
from benchmarks.faults.watch import (
    ReadinessWatch,
    ReadyAnswer,
    SafeSince,
    at_rest_since_s,
    locked_since_s,
    motion_since,
    readiness_of,
)
from distalock.case_client import CaseClient
from distalock.client import RequestRefused
from distalock.robot_readiness import NotDone, make_robot_ready
from services.ui_api.core.chain import ChainBroken
from services.ui_api.record.database import existing_database, sqlite_url
from services.ui_api.record.verify import verify_record

# Generous: starting a service takes ten seconds on a machine that is busy otherwise.
READY_WITHIN_S: Final = 120.0
_ATTEMPT_WITHIN_S: Final = 10.0
_IMAGES_WITHIN_S: Final = 120.0
_LOCKED_WITHIN_S: Final = 15.0
_POLL_S: Final = 0.1
_ROBOT, _ROBOT_STATE = "robot", "robot_state"


class NotReadyAgain(Exception):
    """The installation does not come back; the message says what is not ready."""


@dataclass(frozen=True, slots=True)
class Finding:
    """What came of a combination.

    Attributes
    ----------
    wrong
        What did not hold; empty when the combination was survived.
    said
        Why the procedure did not go on at once, in the installation's own words.
    safe_s, travel_mm
        From the fault to at rest and locked, and the way until then; None when the robot never was.
    ready_s
        From when the cause began to be taken away until `readyz` said yes; the start of a process counts.
    noticed_s
        When `readyz` said yes for the last time while the fault lasted; None when it never did.
    """

    fault: str
    step: str
    wrong: tuple[str, ...]
    said: tuple[str, ...]
    safe_s: float | None
    travel_mm: float
    ready_s: float
    noticed_s: float | None

    @property
    def survived(self) -> bool:
        """Whether everything held."""
        return not self.wrong


@dataclass(slots=True)
class Combination:
    """A fault at the step that a procedure has reached."""

    site: FaultSite
    procedure: PatientProcedure
    fault: Fault
    step: Step
    wrong: list[str] = field(default_factory=list)

    def play(self) -> Finding:
        """Let the fault come and go."""
        with readiness_of(self.site) as watch:
            return self._watched(watch)

    def _watched(self, watch: ReadinessWatch) -> Finding:
        said = self.procedure.said
        said.clear()
        before = self.site.hexapod()
        with watch.asking(), self.fault.injected(self.site):
            injected_s = time.monotonic()
            motion = motion_since(self.site, before, self._safe_since_s())
            was_locked = before.safe_since_s is not None
            self.wrong += wrong_in_motion(self.fault, self.step, motion, was_locked=was_locked)
            self._ask_for_the_next_thing()
            time.sleep(max(injected_s + self.fault.lasts_s - time.monotonic(), 0.0))
            lifted_s = time.monotonic()
        noticed_s = watch.last_ready_s(injected_s, lifted_s)
        self.wrong += wrong_in_readiness(self.fault, noticed_s)
        self._wait_until_ready(watch)
        ready_s = time.monotonic() - lifted_s
        self._check_robot()
        self._check_record()
        self._check_images()
        return Finding(
            self.fault.name,
            self.step,
            tuple(self.wrong),
            tuple(dict.fromkeys(said)),
            motion.safe_s,
            motion.travel_mm,
            ready_s,
            noticed_s,
        )

    def _safe_since_s(self) -> SafeSince:
        unreachable = self.step is Step.MOVING and self.fault.in_motion is InMotion.UNREACHABLE
        return at_rest_since_s if unreachable else locked_since_s

    def _ask_for_the_next_thing(self) -> None:
        said = self.procedure.said
        with AcknowledgingClient.of(
            self.site.room.installation, self.site.acknowledged, _ATTEMPT_WITHIN_S
        ) as impatient:
            self.procedure.try_during_fault(impatient)
        self.wrong += wrong_in_answers(self.fault, said)

    def _wait_until_ready(self, watch: ReadinessWatch) -> None:
        """Until `readyz` says yes; processes that end meanwhile are started again, as their supervisor would."""
        deadline_s = time.monotonic() + READY_WITHIN_S
        while not (answer := watch.ask()).ready:
            for name in self.site.room.fleet.ended:
                if name not in (*self.fault.may_end, _ROBOT):
                    self.wrong.append(f"{name} ended by itself: {self.site.room.fleet.last_words(name)}")
                self.site.room.fleet.restart(name)
            if _ROBOT_STATE in answer.failed and answer.failed.keys() <= {_ROBOT, _ROBOT_STATE}:
                self._reset_robot(answer)
            if time.monotonic() > deadline_s:
                raise NotReadyAgain(f"not ready {READY_WITHIN_S:g} s after the fault had gone: {answer.detail}")
            time.sleep(_POLL_S)

    def _reset_robot(self, answer: ReadyAnswer) -> None:
        """A robot in fault stays so until a person resets it, who does so when nothing else is wrong any more."""
        if answer.failed[_ROBOT_STATE] in ("fault", "disconnected"):
            with suppress(RequestRefused, NotDone, httpx.HTTPError):
                make_robot_ready(self.procedure.rest)

    def _check_robot(self) -> None:
        deadline_s = time.monotonic() + _LOCKED_WITHIN_S
        while self.site.hexapod().safe_since_s is None:
            if time.monotonic() > deadline_s:
                self.wrong.append("the robot is not at rest and locked after everything was ready again")
                return
            time.sleep(_POLL_S)
        if self.site.hexapod().was_unheld:
            self.wrong.append("the platform was held by neither brake nor servo")

    def _check_record(self) -> None:
        verdict = verify_record(existing_database(sqlite_url(self.site.record_file.parent)))
        if isinstance(verdict, ChainBroken):
            self.wrong.append(f"the record is broken: {verdict.message}")
        lost = self.site.acknowledged.lost_answers(self.site.room.rest)
        if lost:
            self.wrong.append(f"acknowledged and lost: {', '.join(lost)}")
        if count := self.site.acknowledged.steps_lost(self.site.record_file):
            self.wrong.append(f"{count} acknowledged steps are lost")

    def _check_images(self) -> None:
        """Every image that was acknowledged is on record, and localised or explained."""
        acknowledged, case_id = self.site.acknowledged, self.procedure.actions.case_id
        deadline_s = time.monotonic() + _IMAGES_WITHIN_S
        while True:
            missing = acknowledged.images_not_on_record(self.site.record_file)
            unfinished = acknowledged.unfinished_images(CaseClient(self.procedure.rest, case_id)) if case_id else []
            if not missing and not unfinished:
                return
            if time.monotonic() > deadline_s:
                break
            time.sleep(_POLL_S)
        if missing:
            self.wrong.append(f"{len(missing)} acknowledged images are not on record")
        if unfinished:
            self.wrong.append(f"{len(unfinished)} acknowledged images are neither localised nor explained")
