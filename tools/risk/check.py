"""`distalock risk check`: every hazard has a control, every control a test that ran on these sources and passed."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from tools.risk.evidence import ROOT, Ending, MarkedTest, Results, digest_of_sources, marked_tests, read_results
from tools.risk.files import Hazard, RiskFile, load_risk_file
from tools.risk.scales import Acceptance

_S_PER_H: Final = 3600.0


def main(results: Path, most_age_h: float, *, with_long_tests: bool) -> int:
    """Print what is wrong; 0 when nothing is, 1 otherwise.

    Raises
    ------
    InputError
        When the risk file or the results cannot be read.
    """
    risk, tests, ran = load_risk_file(), marked_tests(), read_results(results)
    wrong = [*gaps(risk, tests), *unshown(risk, tests, ran, with_long_tests=with_long_tests), *stale(ran, most_age_h)]
    for sentence in wrong:
        print(f"distalock risk check: {sentence}", file=sys.stderr)  # noqa: T201 - a command's output
    if not wrong:
        shown = f"{len(risk.hazards)} hazards, {len(risk.requirements)} requirements, {len(tests)} tests"
        print(f"risk file: {shown}; every control has tests that ran and passed")  # noqa: T201
    return int(bool(wrong))


def gaps(risk: RiskFile, tests: tuple[MarkedTest, ...], root: Path = ROOT) -> list[str]:
    """What does not agree among files and marks, whatever ran; one sentence each."""
    known = {one.id for one in risk.requirements}
    items = {one.id for one in risk.items}
    marked = {requirement for test in tests for requirement in test.requirements}
    controls = {control.requirement for hazard in risk.hazards for control in hazard.controls}
    return [
        *_repeated(risk),
        *(f"requirement {one} has no test: mark one" for one in sorted(known - marked)),
        *(f"requirement {one} controls no hazard: name it in hazards.yaml" for one in sorted(known - controls)),
        *(f"{one} is marked by a test and is no requirement" for one in sorted(marked - known)),
        *(f"requirement {r.id} is of item {r.item!r}, which software.yaml lacks" for r in risk.requirements
          if r.item not in items),
        *(f"requirement {r.id} names docs/{r.page}, which is not there" for r in risk.requirements
          if not (root / "docs" / r.page.partition("#")[0]).is_file()),
        *(sentence for hazard in risk.hazards for sentence in _gaps_of(hazard, known, tests)),
        *_gaps_of_use(risk, tests),
    ]  # fmt: skip


def _repeated(risk: RiskFile) -> Iterator[str]:
    for kind in (risk.hazards, risk.requirements, risk.items, risk.use_errors):
        ids = [one.id for one in kind]
        yield from (f"{one} stands there {ids.count(one)} times" for one in sorted(set(ids)) if ids.count(one) > 1)


def _gaps_of_use(risk: RiskFile, tests: tuple[MarkedTest, ...]) -> Iterator[str]:
    marked = {test.name for test in tests}
    hazards = {hazard.id for hazard in risk.hazards}
    for error in risk.use_errors:
        if error.hazard not in hazards:
            yield f"{error.id} leads to {error.hazard}, which is no hazard"
        yield from (f"{error.id}: test {name} carries no mark" for name in error.shown_by if name not in marked)


def _gaps_of(hazard: Hazard, known: set[str], tests: tuple[MarkedTest, ...]) -> Iterator[str]:
    if hazard.residual is Acceptance.UNACCEPTABLE:
        yield f"{hazard.id}: {hazard.severity} and {hazard.after} is not acceptable; add a control"
    if hazard.residual is Acceptance.REDUCE and not hazard.left:
        yield f"{hazard.id}: what is left is not stated"
    for control in hazard.controls:
        if control.requirement not in known:
            yield f"{hazard.id}: control {control.requirement} is no requirement"
        shows = {test.name for test in tests if control.requirement in test.requirements}
        for name in control.shown_by:
            if name not in shows:
                yield f"{hazard.id}: no test {name} carries the mark of {control.requirement}"


def unshown(risk: RiskFile, tests: tuple[MarkedTest, ...], ran: Results, *, with_long_tests: bool = True) -> list[str]:
    """Requirements whose tests did not all run and pass, and what they control.

    Long tests need not have run where they are not asked for; of each requirement another must have.
    """
    left_out = [test for test in tests if test.is_long and ran.of(test) is Ending.NOT_RUN and not with_long_tests]
    expected = [test for test in tests if test not in left_out]
    shown_otherwise = {requirement for test in expected for requirement in test.requirements}
    only_long = {requirement for test in left_out for requirement in test.requirements} - shown_otherwise
    return [
        *(f"{test.file}::{test.name} {_ENDED[ending]}: {requirement} is not shown, which controls "
          f"{_controlled_by(risk, requirement)}"
          for test in expected
          for ending in (ran.of(test),)
          if ending is not Ending.PASSED
          for requirement in sorted(test.requirements)),
        *(f"only long tests show {requirement}, which controls {_controlled_by(risk, requirement)}: mark another, or "
          "run them and give --with-long-tests"
          for requirement in sorted(only_long)),
    ]  # fmt: skip


def _controlled_by(risk: RiskFile, requirement: str) -> str:
    hazards = [h.id for h in risk.hazards for control in h.controls if control.requirement == requirement]
    return ", ".join(hazards or ["nothing"])


_ENDED: Final = {
    Ending.FAILED: "failed",
    Ending.SKIPPED: "was skipped",
    Ending.NOT_RUN: "did not run",
}


def stale(ran: Results, most_age_h: float) -> list[str]:
    """Why results count no more."""
    found = []
    if ran.oldest_s > most_age_h * _S_PER_H:
        age_h = ran.oldest_s / _S_PER_H
        found.append(f"the oldest result is {age_h:.1f} h old (limit {most_age_h:g} h); run `make test`")
    if ran.sources != {digest_of_sources()}:
        found.append("the results are of other sources than these; run `make test`")
    return found
