"""How far a case is: the tables of stage and aim."""

import pytest

from services.ui_api.core.procedure import Aim, Progress, Stage, Trigger


def _after(*triggers: Trigger) -> Progress:
    progress = Progress()
    for trigger in triggers:
        progress = progress.after(trigger)
    return progress


def test_a_case_goes_from_image_to_drilled_holes() -> None:
    approved = _after(Trigger.IMAGE_RECEIVED, Trigger.LOCALISATION_ACCEPTED, Trigger.PLAN_MADE, Trigger.PLAN_APPROVED)
    assert (approved.stage, approved.aim, approved.seen) == (Stage.POSITIONING, Aim.APPROVED, True)
    aligned = approved.after(Trigger.MOTION_REQUESTED).after(Trigger.MOTION_REACHED)
    assert (aligned.stage, aligned.aim, aligned.seen) == (Stage.ALIGNED, Aim.NONE, False)
    verified = aligned.after(Trigger.IMAGE_RECEIVED).after(Trigger.VERIFICATION_ACCEPTED)
    drilled = verified.after(Trigger.ALL_HOLES_DRILLED)
    assert drilled.after(Trigger.ROBOT_REMOVED).after(Trigger.FINISHED).closed


@pytest.mark.parametrize("stage", [Stage.FINISHED, Stage.ABANDONED])
@pytest.mark.parametrize("trigger", Trigger)
def test_a_closed_case_stays_closed(stage: Stage, trigger: Trigger) -> None:
    assert Progress(stage).after(trigger).stage is stage


@pytest.mark.parametrize("aim", Aim)
@pytest.mark.parametrize(
    "trigger", [Trigger.IMAGE_RECEIVED, Trigger.SETUP_CHANGED, Trigger.MOTION_REACHED, Trigger.MOTION_CUT_SHORT]
)
def test_what_makes_results_stale_leaves_no_aim(aim: Aim, trigger: Trigger) -> None:
    assert Progress(aim=aim).after(trigger).aim is Aim.NONE


def test_a_plan_from_several_images_can_be_approved_and_the_approval_withdrawn() -> None:
    approved = _after(Trigger.LOCALISATION_REJECTED, Trigger.PLAN_MADE, Trigger.PLAN_APPROVED)
    assert approved.aim is Aim.APPROVED
    assert approved.after(Trigger.APPROVAL_WITHDRAWN).aim is Aim.PLANNED


@pytest.mark.requirement("GW-04")
def test_a_rejected_verification_takes_the_leave_to_drill_back() -> None:
    assert Progress(Stage.VERIFIED).after(Trigger.VERIFICATION_REJECTED).stage is Stage.ALIGNED
