"""The check of the risk file finds each kind of gap, and nothing where there is none."""

import json
import time
from dataclasses import replace
from pathlib import Path

import pytest

from shared.errors import InputError
from tools.risk import check
from tools.risk.evidence import Ending, MarkedTest, Results, digest_of_sources, marked_tests, read_results
from tools.risk.files import Control, Hazard, Requirement, RiskFile, SoftwareItem, entries
from tools.risk.scales import Probability, Severity

REQUIREMENT = Requirement(id="ROB-01", item="robot", kind="design", text="A stop is legal.", page="safety.md")
HAZARD = Hazard(
    id="H01",
    hazard="It goes on moving",
    sequence=("Somebody asks for a stop", "Nothing happens"),
    harm="Soft tissue injured",
    severity=Severity.CRITICAL,
    before=Probability.PROBABLE,
    after=Probability.IMPROBABLE,
    controls=(Control(requirement="ROB-01", shown_by=("test_stop",)),),
)
ITEM = SoftwareItem.model_validate(
    {"id": "robot", "name": "Robot", "paths": ("services/robot",), "class": "C", "does": "Moves.", "why": "It moves."}
)
RISK = RiskFile((HAZARD,), (REQUIREMENT,), (ITEM,))
STOP = MarkedTest("tests/test_it.py", "test_stop", frozenset({"ROB-01"}))
PASSED = Results({(STOP.file, STOP.name): ("passed",)}, 1.0, frozenset({digest_of_sources()}))


def changed(**values: object) -> RiskFile:
    return replace(RISK, hazards=(HAZARD.model_copy(update=values),))


def test_a_risk_file_that_agrees_has_no_gap() -> None:
    assert check.gaps(RISK, (STOP,)) == []
    assert check.unshown(RISK, (STOP,), PASSED) == []
    assert check.stale(PASSED, 24) == []


@pytest.mark.parametrize(
    ("risk", "tests", "sentence"),
    [
        (RISK, (), "requirement ROB-01 has no test"),
        (RISK, (STOP, replace(STOP, requirements=frozenset({"ROB-99"}))), "ROB-99 is marked by a test"),
        (RISK, (replace(STOP, name="test_other"),), "no test test_stop carries the mark of ROB-01"),
        (replace(RISK, hazards=()), (STOP,), "requirement ROB-01 controls no hazard"),
        (replace(RISK, items=()), (STOP,), "which software.yaml lacks"),
        (replace(RISK, hazards=(HAZARD, HAZARD)), (STOP,), "H01 stands there 2 times"),
        (changed(after=Probability.OCCASIONAL), (STOP,), "critical and occasional is not acceptable"),
        (changed(after=Probability.REMOTE), (STOP,), "what is left is not stated"),
        (replace(RISK, requirements=()), (STOP,), "control ROB-01 is no requirement"),
        (
            replace(RISK, requirements=(REQUIREMENT.model_copy(update={"page": "no.md"}),)),
            (STOP,),
            "docs/no.md, which is not there",
        ),
    ],
)
def test_every_gap_is_a_sentence(risk: RiskFile, tests: tuple[MarkedTest, ...], sentence: str) -> None:
    assert any(sentence in one for one in check.gaps(risk, tests))


@pytest.mark.parametrize(
    ("outcomes", "ending"),
    [
        (("passed", "failed"), Ending.FAILED),
        (("passed", "skipped"), Ending.PASSED),
        (("skipped",), Ending.SKIPPED),
        ((), Ending.NOT_RUN),
    ],
)
def test_the_worst_of_a_tests_parameters_counts(outcomes: tuple[str, ...], ending: Ending) -> None:
    ran = replace(PASSED, outcomes={(STOP.file, STOP.name): outcomes})
    assert ran.of(STOP) is ending
    sentences = check.unshown(RISK, (STOP,), ran)
    assert (sentences == []) == (ending is Ending.PASSED)
    assert all("ROB-01 is not shown, which controls H01" in one for one in sentences)


def test_long_tests_may_be_left_out_where_another_shows_the_same() -> None:
    long = replace(STOP, name="test_stop_of_hours", is_long=True)
    assert check.unshown(RISK, (STOP, long), PASSED, with_long_tests=False) == []
    (left_out,) = check.unshown(RISK, (STOP, long), PASSED)
    assert "test_stop_of_hours did not run: ROB-01 is not shown, which controls H01" in left_out
    (alone,) = check.unshown(RISK, (long,), PASSED, with_long_tests=False)
    assert "only long tests show ROB-01, which controls H01" in alone
    failed = replace(PASSED, outcomes={**PASSED.outcomes, (long.file, long.name): ("failed",)})
    assert len(check.unshown(RISK, (STOP, long), failed, with_long_tests=False)) == 1


def test_marks_are_read_from_the_sources(tmp_path: Path) -> None:
    marks = '@pytest.mark.requirement("ROB-01")\n'
    lines = f"{marks}def test_stop(): ...\n{marks}@pytest.mark.long\ndef test_stop_of_hours(): ...\n"
    (tmp_path / "tests").mkdir()
    (tmp_path / "tests" / "test_it.py").write_text(lines)
    assert marked_tests(tmp_path) == (STOP, replace(STOP, name="test_stop_of_hours", is_long=True))


def test_old_results_and_those_of_other_sources_do_not_count() -> None:
    assert "25.0 h old (limit 24 h)" in check.stale(replace(PASSED, oldest_s=90_000.0), 24)[0]
    assert "of other sources" in check.stale(replace(PASSED, sources=frozenset({"before"})), 24)[0]


def test_results_of_several_runs_are_read_together(tmp_path: Path) -> None:
    for number, name in enumerate(["test_stop[1]", "test_stop[2]"]):
        row = {"test": f"{STOP.file}::{name}", "outcome": "passed", "at_s": time.time() - 60, "sources": "abc"}
        (tmp_path / f"{number}.jsonl").write_text(json.dumps(row) + "\n")
    ran = read_results(tmp_path)
    assert ran.outcomes == {(STOP.file, "test_stop"): ("passed", "passed")}
    assert ran.oldest_s == pytest.approx(60.0, abs=5.0)
    assert ran.sources == {"abc"}


@pytest.mark.parametrize(("content", "sentence"), [(None, "no results of tests"), ("{", "a line is no result")])
def test_without_results_nothing_is_shown(tmp_path: Path, content: str | None, sentence: str) -> None:
    if content is not None:
        (tmp_path / "1.jsonl").write_text(content)
    with pytest.raises(InputError, match=sentence):
        read_results(tmp_path)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("- {id: ROB-01", "cannot be read"),
        ("- {id: ROB-1, item: robot, kind: design, text: A stop., page: safety.md}", "entry 0.id"),
        ("- {id: ROB-01, item: robot, kind: luck, text: A stop., page: safety.md}", "entry 0.kind"),
        ("- {id: ROB-01, item: robot, kind: design, text: A stop., page: 3}", "entry 0.page"),
    ],
)
def test_an_entry_that_is_none_is_named(tmp_path: Path, content: str, sentence: str) -> None:
    file = tmp_path / "requirements.yaml"
    file.write_text(content)
    with pytest.raises(InputError, match=sentence):
        entries(file, Requirement)


def test_a_hazard_that_controls_make_more_probable_is_refused() -> None:
    values = HAZARD.model_dump(by_alias=True) | {"before": Probability.REMOTE, "after": Probability.PROBABLE}
    with pytest.raises(ValueError, match="is above that before"):
        Hazard.model_validate(values)
