"""The procedure's tables."""

import itertools

import pytest

from services.ui_api.core.event_data import Step
from services.ui_api.core.inside import Inside, ObjectKind, removing_step_of
from services.ui_api.core.procedure import (
    Action,
    Aim,
    Progress,
    Stage,
    Trigger,
    allowed_actions,
    allowed_steps,
    may_be_recorded_with_a_reason,
    next_sentence,
)

_INSIDE = (frozenset[Inside](), *(frozenset({Inside(kind, "distal")}) for kind in ObjectKind))
_EVERY_PROGRESS = [Progress(*values) for values in itertools.product(Stage, Aim, _INSIDE)]


def _after(*triggers: Trigger) -> Progress:
    progress = Progress()
    for trigger in triggers:
        progress = progress.after(trigger)
    return progress


def test_a_case_goes_from_image_to_drilled_holes() -> None:
    approved = _after(Trigger.IMAGE_RECEIVED, Trigger.LOCALISATION_ACCEPTED, Trigger.PLAN_MADE, Trigger.PLAN_APPROVED)
    assert (approved.stage, approved.aim) == (Stage.POSITIONING, Aim.APPROVED)
    assert Action.START_MOTION in allowed_actions(approved)
    moving = approved.after(Trigger.MOTION_REQUESTED)
    assert allowed_actions(moving) == (Action.STOP,)
    aligned = moving.after(Trigger.MOTION_REACHED)
    assert (aligned.stage, aligned.aim) == (Stage.ALIGNED, Aim.NONE)
    verified = aligned.after(Trigger.IMAGE_RECEIVED).after(Trigger.VERIFICATION_ACCEPTED)
    assert Step.DRILLED in allowed_steps(verified)
    drilled = verified.after(Trigger.ALL_HOLES_DRILLED)
    assert drilled.after(Trigger.ROBOT_REMOVED).after(Trigger.FINISHED).closed


@pytest.mark.parametrize("stage", [Stage.FINISHED, Stage.ABANDONED])
@pytest.mark.parametrize("trigger", Trigger)
def test_a_closed_case_stays_closed(stage: Stage, trigger: Trigger) -> None:
    progress = Progress(stage).after(trigger)
    assert progress.stage is stage
    assert allowed_actions(progress) == ()
    assert allowed_steps(progress) == ()


@pytest.mark.parametrize("aim", Aim)
@pytest.mark.parametrize(
    "trigger", [Trigger.IMAGE_RECEIVED, Trigger.SETUP_CHANGED, Trigger.MOTION_REACHED, Trigger.MOTION_CUT_SHORT]
)
def test_what_makes_results_stale_leaves_no_aim(aim: Aim, trigger: Trigger) -> None:
    assert Progress(aim=aim).after(trigger).aim is Aim.NONE


@pytest.mark.parametrize("progress", _EVERY_PROGRESS, ids=str)
def test_no_motion_is_offered_but_from_an_approved_plan_with_nothing_inside(progress: Progress) -> None:
    if Action.START_MOTION in allowed_actions(progress):
        assert progress.aim is Aim.APPROVED
        assert not progress.inside
        assert progress.stage in {Stage.POSITIONING, Stage.ALIGNED, Stage.VERIFIED}


@pytest.mark.parametrize("progress", _EVERY_PROGRESS, ids=str)
def test_stop_is_offered_as_long_as_the_case_is_open(progress: Progress) -> None:
    assert (Action.STOP in allowed_actions(progress)) is not progress.closed
    assert next_sentence(progress).endswith(".")


@pytest.mark.parametrize("stage", [s for s in Stage if s is not Stage.VERIFIED])
def test_drilling_is_in_order_only_after_an_accepted_verification(stage: Stage) -> None:
    assert Step.DRILLED not in allowed_steps(Progress(stage))


def test_hands_stay_off_while_the_robot_moves() -> None:
    assert not may_be_recorded_with_a_reason(Progress(Stage.MOVING))
    assert may_be_recorded_with_a_reason(Progress(Stage.POSITIONING))


def test_a_rejected_verification_takes_the_leave_to_drill_back() -> None:
    assert Progress(Stage.VERIFIED).after(Trigger.VERIFICATION_REJECTED).stage is Stage.ALIGNED


@pytest.mark.parametrize("kind", ObjectKind)
def test_only_what_is_inside_can_be_removed(kind: ObjectKind) -> None:
    step = removing_step_of(kind)
    inside = frozenset({Inside(kind, "distal")})
    for stage in (Stage.POSITIONING, Stage.ALIGNED, Stage.VERIFIED, Stage.DRILLED, Stage.ROBOT_REMOVED):
        assert step not in allowed_steps(Progress(stage))
        assert step in allowed_steps(Progress(stage, inside=inside))


def test_people_are_told_what_to_take_out() -> None:
    inside = frozenset({Inside(ObjectKind.WIRE, "distal"), Inside(ObjectKind.SCREW, "proximal")})
    assert next_sentence(Progress(inside=inside)).startswith("Remove the screws and wires: the robot does not move")
