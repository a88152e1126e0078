"""Play passes: several on one installation, and a new one after a combination that was not survived."""

import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final, TypeAlias

import httpx

from benchmarks.faults.acknowledged import AcknowledgingClient
from benchmarks.faults.combination import Combination, Finding, NotReadyAgain
from benchmarks.faults.passes import Pass, Planned
from benchmarks.faults.patient import PatientProcedure, Step, Stuck
from benchmarks.faults.site import FaultSite, fault_site
from distalock.client import RequestRefused
from shared.errors import ConfigurationError

_ANSWER_S: Final = 180.0
# A new one now and then: its disk and its record are small.
_PASSES_OF_AN_INSTALLATION: Final = 4
# What a broken installation may answer with at any place.
_BREAKDOWNS = (NotReadyAgain, ConfigurationError, RequestRefused, TimeoutError, httpx.HTTPError, OSError, Stuck)


Played: TypeAlias = tuple[Planned, Finding]


def play(next_pass: Callable[[], Pass | None], seed: int, logs: Path | None = None) -> Iterator[Played]:
    """What came of each combination, as soon as it is known what the procedure made of it.

    Parameters
    ----------
    next_pass
        Gives one pass after another, and None at the end.
    seed
        Of the room's scenario.
    logs
        Where the logs of installations go in which a combination was not survived.
    """
    left = list(next_pass() or ())
    while left:
        with (
            fault_site(seed) as site,
            AcknowledgingClient.of(site.room.installation, site.acknowledged, _ANSWER_S) as rest,
        ):
            procedure = PatientProcedure(site, rest)
            for _ in range(_PASSES_OF_AN_INSTALLATION):
                survived = True
                for finding in _until_broken(site, procedure, left):
                    survived = finding.survived
                    if logs is not None and not survived:
                        shutil.copytree(site.state_dir / "logs", logs / left[0].key, dirs_exist_ok=True)
                    yield left.pop(0), finding
                left = left or list(next_pass() or ())
                if not survived or not left:
                    break
                procedure.push_mount()


def _until_broken(site: FaultSite, procedure: PatientProcedure, combinations: list[Planned]) -> Iterator[Finding]:
    """Findings of one installation, up to the first that was not survived."""
    pending: Finding | None = None
    for planned in tuple(combinations):
        procedure.said.clear()
        try:
            _reach(procedure, planned.step)
        except _BREAKDOWNS as error:
            yield _broken(planned, str(error)) if pending is None else _stuck(pending, error)
            return
        if pending is not None:
            yield _with_sequel(pending, procedure)
        pending = _played(site, procedure, planned)
        if not pending.survived:
            yield pending
            return
    if pending is not None:
        procedure.said.clear()
        try:
            procedure.finish()
        except _BREAKDOWNS as error:
            yield _stuck(pending, error)
        else:
            yield _with_sequel(pending, procedure)


def _reach(procedure: PatientProcedure, step: Step) -> None:
    if step is Step.MOVING:
        procedure.require_motion()
    else:
        procedure.reach(step)


def _played(site: FaultSite, procedure: PatientProcedure, planned: Planned) -> Finding:
    combination = Combination(site, procedure, planned.fault, planned.step)
    try:
        return combination.play()
    except _BREAKDOWNS as error:
        return _broken(planned, *combination.wrong, f"{type(error).__name__}: {error}")


def _broken(planned: Planned, *wrong: str) -> Finding:
    return Finding(planned.fault.name, planned.step, wrong, (), None, 0.0, 0.0, None)


def _stuck(finding: Finding, error: Exception) -> Finding:
    return replace(finding, wrong=(*finding.wrong, f"the procedure did not go on: {error}"))


def _with_sequel(finding: Finding, procedure: PatientProcedure) -> Finding:
    return replace(finding, said=tuple(dict.fromkeys((*finding.said, *procedure.said))))
