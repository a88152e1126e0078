"""Play passes: one installation for each, and a new one after a combination that was not survived."""

import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import httpx

from benchmarks.faults.acknowledged import AcknowledgingClient
from benchmarks.faults.combination import Combination, Finding, NotReadyAgain
from benchmarks.faults.passes import Pass, Planned
from benchmarks.faults.patient import PatientProcedure, Step, Stuck
from benchmarks.faults.site import fault_site
from distalock.rest_client import RequestRefused
from shared.errors import ConfigurationError

_ANSWER_S = 30.0
# What a broken installation may answer with at any place.
_BREAKDOWNS = (NotReadyAgain, ConfigurationError, RequestRefused, TimeoutError, httpx.HTTPError, OSError, Stuck)


def play(combinations: Pass, seed: int, logs: Path | None = None) -> Iterator[Finding]:
    """What came of each combination, as soon as it is known what the procedure made of it.

    Parameters
    ----------
    seed
        Of the room's scenario.
    logs
        Where the logs of installations go in which a combination was not survived.
    """
    left = list(combinations)
    while left:
        with fault_site(seed) as site:
            url = site.room.installation.ports.rest_url
            with AcknowledgingClient(url, site.acknowledged, _ANSWER_S) as rest:
                for finding in _until_broken(PatientProcedure(site, rest), left):
                    if logs is not None and not finding.survived:
                        shutil.copytree(site.state_dir / "logs", logs / left[0].key, dirs_exist_ok=True)
                    yield finding
                    del left[0]


def _until_broken(procedure: PatientProcedure, combinations: list[Planned]) -> Iterator[Finding]:
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
        pending = _played(procedure, planned)
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


def _played(procedure: PatientProcedure, planned: Planned) -> Finding:
    combination = Combination(procedure.site, procedure, planned.fault, planned.step)
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
