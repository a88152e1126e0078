"""What counts as survived."""

from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace

import pytest

from benchmarks.faults.declaration import Answers, Fault, InMotion, Readiness
from benchmarks.faults.judgement import wrong_in_answers, wrong_in_motion, wrong_in_readiness
from benchmarks.faults.patient import NO_ANSWER, Step
from benchmarks.faults.site import FaultSite
from benchmarks.faults.watch import Motion


def nothing(_: FaultSite) -> AbstractContextManager[None]:
    return nullcontext()


FAULT = Fault("a fault", nothing, Readiness.NEVER, InMotion.STOPS, Answers.REFUSES)


@pytest.mark.parametrize(
    ("step", "motion", "was_locked", "wrong"),
    [
        (Step.LOCKED, Motion(0.0, 0.0), True, []),
        (Step.LOCKED, Motion(0.3, 0.0), True, ["was to stay locked, was not until 0.30 s later"]),
        (Step.LOCKED, Motion(0.0, 0.0), False, ["was to stay locked"]),
        (Step.LOCKED, Motion(0.0, 0.01), True, ["moved by 0.010 mm"]),
        (Step.MOVING, Motion(0.5, 1.0), False, []),
        (Step.MOVING, Motion(0.6, 0.9), False, ["after 0.60 s (limit 0.5 s)"]),
        (Step.MOVING, Motion(0.6, 1.2), False, ["after 0.60 s", "for 1.20 mm (limit 1 mm)"]),
        (Step.MOVING, Motion(None, 4.0), False, ["not at rest and locked after 15 s"]),
    ],
)
def test_rest_within_the_limits(step: Step, motion: Motion, wrong: list[str], *, was_locked: bool) -> None:
    found = wrong_in_motion(FAULT, step, motion, was_locked=was_locked)
    assert len(found) == len(wrong)
    assert all(part in sentence for part, sentence in zip(wrong, found, strict=True))


def test_a_fault_that_need_not_stop_a_motion_lets_it_go_to_its_target() -> None:
    may_finish = replace(FAULT, in_motion=InMotion.MAY_FINISH)
    assert wrong_in_motion(may_finish, Step.MOVING, Motion(2.0, 4.0), was_locked=False) == []
    assert wrong_in_motion(may_finish, Step.MOVING, Motion(None, 4.0), was_locked=False) != []


def test_readyz_has_time_to_notice_and_no_more() -> None:
    assert wrong_in_readiness(FAULT, None) == []
    assert wrong_in_readiness(FAULT, 4.4) == []
    assert "said yes 4.6 s after" in wrong_in_readiness(FAULT, 4.6)[0]
    assert wrong_in_readiness(replace(FAULT, readiness=Readiness.ANY), 4.6) == []
    assert FAULT.lasts_s > 4.6


def test_silence_counts_only_where_nobody_is_left_to_answer() -> None:
    silent, refused = f"planned: {NO_ANSWER} (ReadTimeout)", "planned: the case record cannot be written now"
    assert wrong_in_answers(FAULT, [refused]) == []
    assert wrong_in_answers(FAULT, [refused, silent]) == [f"while it lasted: {silent}"]
    assert wrong_in_answers(replace(FAULT, answers=Answers.SILENT), [silent]) == []


def test_what_must_not_hinder_the_procedure_does_not_let_it_be_refused() -> None:
    goes_on = replace(FAULT, answers=Answers.GOES_ON)
    assert wrong_in_answers(goes_on, []) == []
    assert "did not go on: planned: stale" in wrong_in_answers(goes_on, ["planned: stale"])[0]
