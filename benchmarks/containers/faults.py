"""Any container killed, frozen or cut off at a step of the procedure: what became of the robot and of the record."""

import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Final

import httpx

from benchmarks.containers.site import ContainerSite, Injected, Prepared, cut_off, killed, paused
from benchmarks.faults.declaration import SAFE_WITHIN_MM, SAFE_WITHIN_S
from benchmarks.faults.patient import PatientProcedure, Step, Stuck
from benchmarks.faults.watch import Motion, ReadinessWatch, ReadyAnswer, at_rest_since_s, locked_since_s, motion_since
from distalock.case_client import CaseClient
from distalock.client import RequestRefused
from distalock.robot_readiness import NotDone, make_robot_ready
from shared.errors import ConfigurationError
from tools.containers.composition import SERVICES

LASTS_S: Final = 10.0
READY_WITHIN_S: Final = 5.0
_GIVE_UP_AFTER_S: Final = 120.0
_IMAGES_WITHIN_S: Final = 60.0
_POLL_S: Final = 0.1
# A service that was killed is on the list of those that are there until its token has gone.
_NOTICED_WITHIN_S: Final = 0.3
_STILL_MM: Final = 1e-3
_ROBOT: Final = frozenset({"robot", "robot_state"})
# Nothing reaches the controller while the robot's network is gone: the motion ends at its target, under its servo.
_UNREACHABLE: Final = ("robot cut off",)


@dataclass(frozen=True, slots=True)
class ContainerFault:
    """What is done to a container."""

    name: str
    prepared: Prepared


FAULTS: Final = tuple(
    fault
    for service in SERVICES
    for fault in (
        ContainerFault(f"{service} killed", killed(service)),
        ContainerFault(f"{service} paused", paused(service, LASTS_S)),
        # The guardian has no network.
        *([] if service == "guardian" else [ContainerFault(f"{service} cut off", cut_off(service, LASTS_S))]),
    )
)


@dataclass(frozen=True, slots=True)
class ContainerFinding:
    """What came of a fault at a step.

    Attributes
    ----------
    wrong
        What did not hold.
    safe_s, travel_mm
        From the fault to at rest and locked; None when it never was.
    ready_s
        From the end of the cause until everything but the state of the robot, which a person resets, was ready.
    """

    fault: str
    step: str
    wrong: tuple[str, ...]
    safe_s: float | None
    travel_mm: float
    ready_s: float

    @property
    def line(self) -> str:
        """For people."""
        safe = "never" if self.safe_s is None else f"{self.safe_s:.2f} s"
        figures = f"safe {safe}, {self.travel_mm:.2f} mm; ready {self.ready_s:.1f} s"
        return f"{self.fault:22} {self.step:12} {figures}  {'; '.join(self.wrong) or 'survived'}"


def play(site: ContainerSite, faults: Sequence[ContainerFault], steps: Sequence[Step]) -> Iterator[ContainerFinding]:
    """Every fault at every step, as soon as it is known what came of it."""
    procedure = PatientProcedure(site, site.gateway)
    for fault in faults:
        for step in steps:
            try:
                procedure.said.clear()
                inject = fault.prepared(site)
                procedure.require_motion() if step is Step.MOVING else procedure.reach(step)
                yield _played(site, procedure, fault, step, inject)
                if procedure.at is not Step.IDLE and step is steps[-1]:
                    procedure.reach(Step.WIRED)
                    procedure.finish()
            except (Stuck, RequestRefused, NotDone, httpx.HTTPError, TimeoutError, ConfigurationError) as error:
                yield ContainerFinding(fault.name, step, (f"{type(error).__name__}: {error}",), None, 0.0, 0.0)
                _begin_anew(site, procedure)


def _begin_anew(site: ContainerSite, procedure: PatientProcedure) -> None:
    """Leave nothing of a procedure that is stuck: wires in the guide would spoil all that follow."""
    with suppress(RequestRefused, NotDone, httpx.HTTPError):
        site.room.room.remove_wires()
    with suppress(RequestRefused, NotDone, httpx.HTTPError):
        procedure.actions.close(procedure.rest)
    procedure.at = Step.IDLE


def _played(
    site: ContainerSite, procedure: PatientProcedure, fault: ContainerFault, step: Step, inject: Injected
) -> ContainerFinding:
    unreachable = step is Step.MOVING and fault.name in _UNREACHABLE
    with site.readiness() as watch:
        before = site.hexapod()
        with inject():
            motion = motion_since(site, before, at_rest_since_s if unreachable else locked_since_s)
        lifted_s = time.monotonic()
        wrong = _wrong_in_motion(motion, step, unreachable=unreachable)
        missing = _wait_until_ready(watch)
        ready_s = time.monotonic() - lifted_s
        if ready_s > READY_WITHIN_S:
            wrong.append(f"ready after {ready_s:.1f} s (limit {READY_WITHIN_S:g} s), {missing}")
        _make_ready(site, watch)
    return ContainerFinding(
        fault.name, step, (*wrong, *_lost(site, procedure)), motion.safe_s, motion.travel_mm, ready_s
    )


def _wrong_in_motion(motion: Motion, step: Step, *, unreachable: bool) -> list[str]:
    if motion.safe_s is None:
        return ["the robot was not at rest and locked after 15 s"]
    if step is not Step.MOVING:
        return [f"the robot at rest moved by {motion.travel_mm:.3f} mm"] if motion.travel_mm > _STILL_MM else []
    if unreachable:
        return []
    wrong = []
    if motion.safe_s > SAFE_WITHIN_S:
        wrong.append(f"at rest and locked after {motion.safe_s:.2f} s (limit {SAFE_WITHIN_S:g} s)")
    if motion.travel_mm > SAFE_WITHIN_MM:
        wrong.append(f"went on for {motion.travel_mm:.2f} mm (limit {SAFE_WITHIN_MM:g} mm)")
    return wrong


def _is_ready(answer: ReadyAnswer) -> bool:
    """Whether all is there; a robot in fault is reset by a person."""
    return answer.ready or (bool(answer.failed) and answer.failed.keys() <= _ROBOT and "robot_state" in answer.failed)


def _wait_until_ready(watch: ReadinessWatch) -> str:
    """What was missing last."""
    deadline_s = time.monotonic() + _GIVE_UP_AFTER_S
    missing = "nothing missing"
    time.sleep(_NOTICED_WITHIN_S)
    while not _is_ready(answer := watch.ask()):
        missing = f"at last without {', '.join(answer.failed) or answer.detail}"
        if time.monotonic() > deadline_s:
            raise TimeoutError(f"not ready {_GIVE_UP_AFTER_S:g} s after the fault had gone: {answer.detail}")
        time.sleep(_POLL_S)
    return missing


def _make_ready(site: ContainerSite, watch: ReadinessWatch) -> None:
    deadline_s = time.monotonic() + _GIVE_UP_AFTER_S
    while not watch.ask().ready:
        with suppress(RequestRefused, NotDone, httpx.HTTPError):
            make_robot_ready(site.gateway)
        if time.monotonic() > deadline_s:
            raise TimeoutError("the robot could not be made ready again")
        time.sleep(_POLL_S)


def _lost(site: ContainerSite, procedure: PatientProcedure) -> list[str]:
    """What was acknowledged and is not there any more."""
    wrong = [f"acknowledged and lost: {path}" for path in site.acknowledged.lost_answers(site.rest)]
    case_id = procedure.actions.case_id
    deadline_s = time.monotonic() + _IMAGES_WITHIN_S
    while case_id and (unfinished := site.acknowledged.unfinished_images(CaseClient(site.gateway, case_id))):
        if time.monotonic() > deadline_s:
            return [*wrong, f"{len(unfinished)} acknowledged images are neither localised nor explained"]
        time.sleep(_POLL_S)
    return wrong
