"""Permits: one that allows its motion, and every way in which it must not."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from services.robot.core import permit_checks
from services.robot.core.permit_checks import RULES, SIGNATURE_REFUSALS, check_permit
from services.robot.core.permits import (
    AskedMotion,
    Motion,
    Permit,
    PermitContext,
    PermitRecord,
    SignatureFailure,
    UsedPermits,
)
from services.robot.core.refusals import Refusal, RefusalCode
from services.robot.core.tuning import PERMITS

NOW_S = 1000.0
SHA, OTHER_SHA = "a" * 64, "b" * 64
PERMIT = Permit(
    motion=Motion.MOVE,
    plan_sha256=SHA,
    hole_ids=("distal",),
    case_id="case1",
    case_revision=2,
    robot_boot_epoch="boot",
    after_state_sequence=7,
    approver="Dr A",
    nothing_inside=True,
    nonce="n1",
)
CONTEXT = PermitContext(
    asked=AskedMotion(Motion.MOVE, SHA, ("distal",)),
    boot_epoch="boot",
    hexapod_sha256=SHA,
    now_s=NOW_S,
    case=("case1", 2),
    inside=(),
    newest_state=9,
    first_since_stop=6,
    quoted_published_s=NOW_S - 0.3,
    used=UsedPermits((("n0", NOW_S - 0.5),)),
)
REFERENCE = replace(PERMIT, motion=Motion.REFERENCE, plan_sha256=None, hole_ids=(), case_id=None, case_revision=0)
FOR_REFERENCE = replace(CONTEXT, asked=AskedMotion(Motion.REFERENCE), case=(None, 0))


def refused(presented: Permit | SignatureFailure, now: PermitContext) -> Refusal:
    outcome = check_permit(presented, now)
    assert isinstance(outcome, Refusal), outcome
    return outcome


def test_a_permit_that_is_right_in_every_way_allows_its_motion() -> None:
    assert check_permit(PERMIT, CONTEXT) == PERMIT
    named = replace(PERMIT, hexapod_sha256=SHA)
    assert check_permit(named, CONTEXT) == named
    assert check_permit(REFERENCE, FOR_REFERENCE) == REFERENCE


def test_a_plan_that_the_robot_does_not_know_is_left_to_the_guard() -> None:
    assert check_permit(PERMIT, replace(CONTEXT, asked=AskedMotion(Motion.MOVE, SHA, None))) == PERMIT


@pytest.mark.requirement("ROB-01")
@pytest.mark.parametrize(
    ("failure", "code", "sentence"),
    [
        (SignatureFailure.MISSING, RefusalCode.PERMIT_MISSING, "carries no permit; ask through the gateway"),
        (SignatureFailure.ALTERED, RefusalCode.PERMIT_ALTERED, "is not the text whose hash came with it; see who else"),
        (SignatureFailure.OTHER_KEY, RefusalCode.PERMIT_OF_ANOTHER_KEY, "names another key than the gateway's"),
        (SignatureFailure.FORGED, RefusalCode.PERMIT_FORGED, "signature is not the gateway's over this text"),
        (SignatureFailure.UNREADABLE, RefusalCode.PERMIT_UNREADABLE, "is not of format version 1; run gateway"),
    ],
)
def test_what_is_not_the_gateways_word_is_refused(failure: SignatureFailure, code: RefusalCode, sentence: str) -> None:
    outcome = refused(failure, CONTEXT)
    assert outcome.code is code
    assert sentence in outcome.message


@pytest.mark.requirement("ROB-01")
@pytest.mark.parametrize(
    ("change", "code", "sentence"),
    [
        (
            lambda p: replace(p, motion=Motion.REFERENCE),
            RefusalCode.PERMIT_FOR_ANOTHER_MOTION,
            "allows a reference, the command asks for a move",
        ),
        (
            lambda p: replace(p, robot_boot_epoch="before"),
            RefusalCode.PERMIT_OF_ANOTHER_BOOT,
            "for boot 'before' of the robot service, this is boot 'boot'",
        ),
        (
            lambda p: replace(p, hexapod_sha256=OTHER_SHA),
            RefusalCode.PERMIT_FOR_ANOTHER_HEXAPOD,
            "for hexapod bbbbbbbbbbbb, this robot is aaaaaaaaaaaa; give case and robot service the same hexapod file",
        ),
        (
            lambda p: replace(p, case_id="case0"),
            RefusalCode.PERMIT_OF_ANOTHER_CASE,
            "for case 'case0', open is case 'case1'",
        ),
        (lambda p: replace(p, case_id=None), RefusalCode.PERMIT_OF_ANOTHER_CASE, "for no case, open is case 'case1'"),
        (
            lambda p: replace(p, case_revision=1),
            RefusalCode.PERMIT_OF_ANOTHER_REVISION,
            "revision 1 of the case, the newest is 2; take an image and plan again",
        ),
        (
            lambda p: replace(p, plan_sha256=OTHER_SHA),
            RefusalCode.PERMIT_FOR_ANOTHER_PLAN,
            "for plan bbbbbbbbbbbb, asked for is plan aaaaaaaaaaaa",
        ),
        (lambda p: replace(p, plan_sha256=None), RefusalCode.PERMIT_FOR_ANOTHER_PLAN, "for plan none"),
        (
            lambda p: replace(p, hole_ids=("distal", "proximal")),
            RefusalCode.PERMIT_FOR_OTHER_HOLES,
            "for holes distal, proximal, the plan for holes distal",
        ),
        (lambda p: replace(p, hole_ids=()), RefusalCode.PERMIT_FOR_OTHER_HOLES, "for holes none, the plan for"),
        (
            lambda p: replace(p, after_state_sequence=10),
            RefusalCode.PERMIT_STATE_UNKNOWN,
            "quotes state 10, which the robot has not published",
        ),
        (lambda p: replace(p, nonce="n0"), RefusalCode.PERMIT_USED, "permit n0 was used before, it allows one motion"),
        (
            lambda p: replace(p, nothing_inside=False),
            RefusalCode.PERMIT_WITHOUT_CLEARANCE,
            "does not say that nothing is in the guide and the bone; take out",
        ),
    ],
)
def test_a_permit_for_something_else_is_refused(
    change: Callable[[Permit], Permit], code: RefusalCode, sentence: str
) -> None:
    outcome = refused(change(PERMIT), CONTEXT)
    assert outcome.code is code
    assert sentence in outcome.message


@pytest.mark.parametrize(
    ("now", "code", "sentence"),
    [
        (replace(CONTEXT, case=None), RefusalCode.PERMIT_OF_ANOTHER_CASE, "has not published which case is open"),
        (replace(CONTEXT, case=(None, 2)), RefusalCode.PERMIT_OF_ANOTHER_CASE, "open is no case"),
        (replace(CONTEXT, newest_state=None), RefusalCode.PERMIT_STATE_UNKNOWN, "state 7, which the robot has not"),
        (replace(CONTEXT, newest_state=6), RefusalCode.PERMIT_STATE_UNKNOWN, "state 7, which the robot has not"),
        (
            replace(CONTEXT, quoted_published_s=None),
            RefusalCode.PERMIT_EXPIRED,
            "quotes state 7, which is out of record, the limit is 2 s",
        ),
        (
            replace(CONTEXT, now_s=NOW_S + 3.2),
            RefusalCode.PERMIT_EXPIRED,
            "quotes state 7, which is 3.50 s old, the limit is 2 s",
        ),
        (
            replace(CONTEXT, first_since_stop=8),
            RefusalCode.PERMIT_BEFORE_STOP,
            "quotes state 7, and a stop has come since; ",
        ),
        (
            replace(CONTEXT, inside=("wire in distal", "screw in proximal")),
            RefusalCode.SOMETHING_INSIDE,
            "the case says: wire in distal, screw in proximal; take them out and record it",
        ),
    ],
)
def test_what_the_robot_knows_itself_counts(now: PermitContext, code: RefusalCode, sentence: str) -> None:
    outcome = refused(PERMIT, now)
    assert outcome.code is code
    assert sentence in outcome.message


def test_a_permit_for_a_reference_moves_nothing_and_the_other_way_round() -> None:
    assert refused(REFERENCE, replace(CONTEXT, case=(None, 0))).code is RefusalCode.PERMIT_FOR_ANOTHER_MOTION
    assert refused(PERMIT, FOR_REFERENCE).code is RefusalCode.PERMIT_FOR_ANOTHER_MOTION
    named = replace(REFERENCE, plan_sha256=SHA)
    assert refused(named, FOR_REFERENCE).message.startswith(
        "the permit is for plan aaaaaaaaaaaa, asked for is plan none"
    )


def test_the_newest_state_may_be_quoted_and_one_just_as_old_as_the_limit() -> None:
    assert check_permit(replace(PERMIT, after_state_sequence=9), CONTEXT).__class__ is Permit
    edge = replace(CONTEXT, quoted_published_s=NOW_S - PERMITS.lifetime_s)
    assert check_permit(PERMIT, edge) == PERMIT


def test_used_permits_are_remembered_until_they_have_expired() -> None:
    used = UsedPermits().with_taken("n1", NOW_S, NOW_S).with_taken("n2", NOW_S + 1.0, NOW_S + PERMITS.lifetime_s)
    assert used.holds("n1")
    assert used.holds("n2")
    later = used.with_taken("n3", NOW_S + 2.5, NOW_S + PERMITS.lifetime_s + 0.5)
    assert not later.holds("n1")
    assert later.holds("n2")
    assert later.holds("n3")


def test_before_the_first_command_nothing_was_taken_or_refused_and_a_reference_is_of_no_plan() -> None:
    assert PermitRecord() == PermitRecord(taken_sha256=None, refused=0, refusal="")
    assert AskedMotion(Motion.REFERENCE) == AskedMotion(Motion.REFERENCE, plan_sha256=None, hole_ids=())


def test_every_rule_has_a_code_of_its_own_and_a_test_here() -> None:
    codes = [rule.code for rule in RULES] + [code for code, _ in SIGNATURE_REFUSALS.values()]
    assert len(set(codes)) == len(codes)
    assert set(SIGNATURE_REFUSALS) == set(SignatureFailure)
    asked_for_here = set(re.findall(r"RefusalCode\.([A-Z_]+)", Path(__file__).read_text()))
    assert set(re.findall(r"RefusalCode\.([A-Z_]+)", Path(permit_checks.__file__).read_text())) <= asked_for_here
