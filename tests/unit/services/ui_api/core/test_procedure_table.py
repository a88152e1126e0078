"""The table of the procedure, over every situation there is."""

import itertools
from collections.abc import Iterator
from functools import cache

import pytest

from services.robot.core.motion import Event, next_motion
from services.robot.core.refusals import Refusal
from services.ui_api.core.event_data import Step
from services.ui_api.core.inside import Inside, ObjectKind, removing_step_of
from services.ui_api.core.next_step import NEXT, Phase, PhaseStatus, next_sentence, next_step, phase_line
from services.ui_api.core.procedure import Aim, Progress, Stage
from services.ui_api.core.procedure_conditions import Judge
from services.ui_api.core.procedure_table import (
    TABLE,
    Action,
    Verdict,
    allowed_actions,
    decide,
    decide_step,
    steps_in_order,
    who_may,
)
from services.ui_api.core.roles import Role
from services.ui_api.core.situation import (
    Basis,
    Pending,
    PlanStanding,
    RobotCondition,
    Situation,
    condition_of,
)
from shared.robot_states import MotionState, StopButton, StopLatch

_INSIDE = (frozenset[Inside](), *(frozenset({Inside(kind, "distal")}) for kind in ObjectKind))


def _situations() -> Iterator[Situation]:
    for stage, inside, seen in itertools.product(Stage, _INSIDE, (False, True)):
        progress = Progress(stage, Aim.NONE, inside, seen)
        for basis, plan, pending, robot, drilled in itertools.product(
            Basis, PlanStanding, Pending, RobotCondition, (False, True)
        ):
            if (pending is Pending.MOVE) is not (stage is Stage.MOVING):
                continue
            yield Situation(
                progress,
                basis,
                plan,
                pending,
                robot,
                seen,
                guide_seen=not drilled,
                some_drilled=drilled,
                all_screwed=not drilled,
                side_agrees=drilled,
                hexapod_agrees=seen,
            )


@cache
def _all() -> tuple[Situation, ...]:
    return tuple(_situations())


@pytest.mark.requirement("GW-14")
def test_what_is_next_is_what_the_table_allows() -> None:
    """In every situation: the sentence asks for nothing that would be refused, and there is always one."""
    for situation in _all():
        following = next_step(situation)
        assert next_sentence(situation).endswith(".")
        does = following.does
        if isinstance(does, Step):
            assert decide_step(situation, does).verdict is Verdict.ALLOWED, (situation, following)
        elif does is not None:
            assert decide(situation, does).verdict is Verdict.ALLOWED, (situation, following)


def test_every_row_of_what_is_next_is_reached() -> None:
    """Rows that nothing reaches would be sentences that nobody ever reads."""
    reached = {id(next_step(situation)) for situation in _all()}
    assert [row.sentence for row in NEXT if id(row) not in reached] == []
    assert {row.phase for row in NEXT} == set(Phase)


@pytest.mark.requirement("GW-14")
def test_a_refusal_has_code_reason_and_remedy_and_a_permission_has_none() -> None:
    for situation in _all()[::7]:
        for action in Action:
            decision = decide(situation, action)
            refused = decision.verdict is Verdict.REFUSED
            assert all(bool(text) is refused for text in (decision.code, decision.reason, decision.remedy)), decision
            assert "{" not in decision.reason + decision.remedy


def test_no_motion_but_from_an_approved_plan_with_a_ready_robot_and_nothing_inside() -> None:
    starts = [s for s in _all() if decide(s, Action.START_MOTION).verdict is Verdict.ALLOWED]
    assert starts
    for situation in starts:
        assert situation.plan is PlanStanding.APPROVED
        assert situation.robot is RobotCondition.READY
        assert not situation.kinds_inside
        assert situation.progress.stage in {Stage.POSITIONING, Stage.ALIGNED, Stage.VERIFIED}
        assert situation.pending is Pending.NOTHING


def test_stop_is_never_refused_and_an_open_case_can_be_abandoned_unless_something_moves() -> None:
    for situation in _all():
        assert decide(situation, Action.STOP).verdict is Verdict.ALLOWED
        at_rest = situation.progress.stage is not Stage.MOVING and situation.pending is Pending.NOTHING
        can_end = not situation.progress.closed and at_rest
        assert (decide_step(situation, Step.ABANDONED).verdict is Verdict.ALLOWED) is can_end


def test_nothing_is_offered_in_a_closed_case() -> None:
    for situation in _all():
        if situation.progress.closed:
            assert allowed_actions(situation) == ()
            assert steps_in_order(situation) == ()
            assert decide(situation, Action.RECORD_STEP).code == "case_closed"


@pytest.mark.requirement("GW-04")
@pytest.mark.parametrize("stage", [s for s in Stage if s not in (Stage.VERIFIED, Stage.DRILLED)])
def test_drilling_is_in_order_only_after_an_accepted_verification(stage: Stage) -> None:
    assert Step.DRILLED not in steps_in_order(Situation(Progress(stage)))


@pytest.mark.parametrize("kind", ObjectKind)
def test_only_what_is_inside_can_be_removed(kind: ObjectKind) -> None:
    step = removing_step_of(kind)
    for stage in (Stage.POSITIONING, Stage.ALIGNED, Stage.VERIFIED, Stage.DRILLED, Stage.ROBOT_REMOVED):
        assert step not in steps_in_order(Situation(Progress(stage)))
        assert step in steps_in_order(Situation(Progress(stage, inside=frozenset({Inside(kind, "distal")}))))


@pytest.mark.parametrize("inside", [frozenset(), frozenset({Inside(ObjectKind.WIRE, "distal")})])
def test_nothing_is_verified_before_the_newest_image_is_localised(inside: frozenset[Inside]) -> None:
    taken = Progress(Stage.ALIGNED, inside=inside, seen=True)
    for basis in Basis:
        following = next_step(Situation(taken, basis=basis, has_images=True))
        is_localised = basis in (Basis.REJECTED, Basis.SEVERAL, Basis.ACCEPTED)
        assert following.does is (Action.VERIFY if is_localised else None)
        assert following.phase is Phase.VERIFICATION
        assert ("being localised" in following.sentence) is not is_localised


def test_what_was_wrong_before_is_right() -> None:
    """A stop in force does not ask for a motion, and wires that are in are not asked for again."""
    stopped = Situation(plan=PlanStanding.APPROVED, robot=RobotCondition.STOPPED)
    assert next_step(stopped).does is Action.ACKNOWLEDGE_STOP
    wires = Progress(Stage.ALIGNED, inside=frozenset({Inside(ObjectKind.WIRE, "distal")}))
    assert next_step(Situation(wires)).does is Action.TAKE_IMAGE
    assert "insert" not in next_sentence(Situation(wires)).lower()


_EVENTS = {
    Action.ACKNOWLEDGE_STOP: Event.ACKNOWLEDGE_REFERENCED,
    Action.REFERENCE: Event.REFERENCE,
    Action.RESET: Event.RESET,
}


@pytest.mark.parametrize("state", MotionState)
@pytest.mark.parametrize("action", _EVENTS)
def test_what_the_robot_is_said_to_refuse_it_refuses_with_the_same_code(state: MotionState, action: Action) -> None:
    at_rest_under_a_stop = state in {MotionState.DISCONNECTED, MotionState.STOPPED, MotionState.FAULT}
    latch = StopLatch.LATCHED if at_rest_under_a_stop else StopLatch.CLEAR
    decision = decide(Situation(robot=condition_of(state, latch, StopButton.ABSENT)), action)
    outcome = next_motion(state, _EVENTS[action])
    assert decision.code == (outcome.code.value if isinstance(outcome, Refusal) else "")
    at_once = (action, state) == (Action.REFERENCE, MotionState.LOCKED)  # what is referenced needs no other state
    assert decision.judge is (Judge.ROBOT if decision.code and not at_once else Judge.GATEWAY)


def test_who_may_is_what_the_roles_say() -> None:
    assert set(TABLE) == set(Action)
    assert who_may(Action.START_MOTION) == who_may(Action.APPROVE_PLAN) == (Role.SURGEON,)
    assert set(who_may(Action.STOP)) == set(Role)


@pytest.mark.parametrize("now", list(Phase))
def test_the_line_of_phases_shows_the_present_one_once_and_detours_only_while_they_last(now: Phase) -> None:
    line = phase_line(now)
    statuses = [status for _, status in line]
    assert [phase for phase, status in line if status is PhaseStatus.NOW] == [now]
    assert statuses == sorted(statuses, key=[PhaseStatus.DONE, PhaseStatus.NOW, PhaseStatus.TO_COME].index)
    assert [phase for phase, _ in line if phase in (Phase.MOUNTING, Phase.WIRES)] == (
        [now] if now in (Phase.MOUNTING, Phase.WIRES) else []
    )
    assert line[0][0] is Phase.SET_UP
    assert line[-1][0] is Phase.CLOSED
