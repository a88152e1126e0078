"""A case as its events add up to it."""

from dataclasses import replace

import pytest

from services.ui_api.core.case import opened_case
from services.ui_api.core.event_data import (
    CaseOpened,
    ImageReceived,
    PlanApproved,
    SetupChanged,
    Step,
    StepRecorded,
)
from services.ui_api.core.events import Event
from services.ui_api.core.guide_moved import UNSEEN
from services.ui_api.core.inside import Inside, ObjectKind
from services.ui_api.core.ledger import Ledger
from services.ui_api.core.procedure import Aim, Stage
from services.ui_api.core.robot_event_data import (
    OperationProgressed,
    OperationStatus,
)
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.core.case_log import Log, asked_for, ended, image, localised, plan


@pytest.fixture
def log() -> Log:
    opened = Log()
    opened.add(CaseOpened(samples.case_setup()))
    return opened


@pytest.fixture
def approved(log: Log) -> Log:
    """A case whose plan a surgeon has approved."""
    log.add(image("one"), localised(1, "one"), plan(1, "one"), PlanApproved(1, "f" * 64, "Dr A", 1))
    return log


def test_a_localisation_that_comes_after_a_newer_image_is_no_aim(log: Log) -> None:
    case = log.add(image("one"), image("two"), localised(1, "one"))
    assert case.progress.aim is Aim.NONE
    assert log.add(localised(2, "two")).progress.aim is Aim.LOCALISED


def test_a_localisation_of_an_older_set_up_is_no_aim(log: Log) -> None:
    log.add(image("one"), SetupChanged(2, samples.case_setup()))
    assert log.add(localised(1, "one", revision=1)).progress.aim is Aim.NONE


def test_a_plan_that_comes_after_a_newer_image_is_no_aim(log: Log) -> None:
    case = log.add(image("one"), localised(1, "one"), image("two"), plan(1, "one"))
    assert (len(case.plans), case.progress.aim) == (1, Aim.NONE)


def test_a_motion_that_never_began_leaves_everything_as_it_was(approved: Log) -> None:
    before = approved.ledger.cases["case-1"]
    moving = approved.add(asked_for("move", "op"))
    assert (moving.progress.stage, moving.plans[0].used) == (Stage.MOVING, True)
    after = approved.add(ended("op", OperationStatus.FAILED, began=False))
    assert (after.progress, after.plans) == (before.progress, before.plans)
    assert after.staleness_of_image(after.images[-1].image_sha256, 1) is None


@pytest.mark.parametrize("status", [OperationStatus.SUCCEEDED, OperationStatus.STOPPED])
def test_an_image_of_before_a_motion_shows_a_robot_that_stood_elsewhere(approved: Log, status: OperationStatus) -> None:
    case = approved.add(asked_for("move", "op"), ended("op", status, began=True))
    assert case.staleness_of_image(case.images[-1].image_sha256, 1) == "the robot has moved since it was taken"
    case = approved.add(image("two"))
    assert case.staleness_of_image(case.images[-1].image_sha256, 1) is None
    assert approved.add(localised(2, "two")).progress.aim is Aim.LOCALISED


@pytest.mark.parametrize(
    ("status", "stage"),
    [
        (OperationStatus.SUCCEEDED, Stage.ALIGNED),
        (OperationStatus.STOPPED, Stage.POSITIONING),
        (OperationStatus.FAILED, Stage.POSITIONING),
    ],
)
def test_a_motion_that_began_uses_its_plan_up(approved: Log, status: OperationStatus, stage: Stage) -> None:
    case = approved.add(asked_for("move", "op"), ended("op", status, began=True))
    assert (case.progress.stage, case.progress.aim, case.plans[0].used) == (stage, Aim.NONE, True)
    assert case.motions == ("op",)


def test_holes_are_drilled_one_by_one(log: Log) -> None:
    case = log.add(StepRecorded(Step.DRILLED, ("distal",), True, "why"))
    assert (case.drilled_hole_ids, case.progress.stage) == (frozenset({"distal"}), Stage.POSITIONING)
    assert log.add(StepRecorded(Step.DRILLED, ("proximal",), True, "why")).progress.stage is Stage.DRILLED


def test_wires_are_followed_hole_by_hole(log: Log) -> None:
    case = log.add(StepRecorded(Step.WIRES_INSERTED, (), True, "why"))
    assert case.progress.wired_hole_ids == {"proximal", "distal"}
    case = log.add(StepRecorded(Step.WIRES_REMOVED, ("distal",), False, ""))
    assert case.progress.wired_hole_ids == {"proximal"}


@pytest.mark.parametrize(
    ("inserted", "removed", "kind"),
    [
        (Step.WIRES_INSERTED, Step.WIRES_REMOVED, ObjectKind.WIRE),
        (Step.DRILL_INSERTED, Step.DRILL_REMOVED, ObjectKind.DRILL),
        (Step.DRILL_INSERTED, Step.DRILLED, ObjectKind.DRILL),
        (Step.SCREWS_INSERTED, Step.SCREWS_REMOVED, ObjectKind.SCREW),
    ],
)
def test_what_goes_in_is_inside_until_it_is_reported_out(
    log: Log, inserted: Step, removed: Step, kind: ObjectKind
) -> None:
    log.add(StepRecorded(inserted, (), True, "why"))
    assert log.ledger.inside() == (Inside(kind, "distal"), Inside(kind, "proximal"))
    log.add(StepRecorded(removed, ("proximal",), True, "why"))
    assert log.ledger.inside() == (Inside(kind, "distal"),)
    log.add(StepRecorded(removed, ("distal",), True, "why"))
    assert log.ledger.inside() == ()


def test_what_went_in_through_other_parts_comes_out_all_the_same(log: Log) -> None:
    log.add(StepRecorded(Step.WIRES_INSERTED, ("distal",), True, "why"))
    setup = samples.case_setup()
    other = replace(setup.nail, hole_ids=("h1", "h2"))
    case = log.add(SetupChanged(2, replace(setup, nail=other, guide=other)))
    assert case.hole_ids == ("h1", "h2")
    assert case.holes_meant_by(Step.WIRES_REMOVED) == ("h1", "h2", "distal")
    assert case.holes_meant_by(Step.DRILL_REMOVED) == ("h1", "h2")
    log.add(StepRecorded(Step.WIRES_REMOVED, (), False, ""))
    assert log.ledger.inside() == ()


@pytest.mark.requirement("GW-13")
def test_what_an_abandoned_case_left_beside_the_robot_stays_inside(log: Log) -> None:
    log.add(StepRecorded(Step.WIRES_INSERTED, ("distal",), True, "why"))
    log.add(StepRecorded(Step.ABANDONED, (), False, ""))
    assert log.ledger.inside() == (Inside(ObjectKind.WIRE, "distal"),)


def test_what_stays_in_the_bone_does_not_matter_once_the_robot_is_off(log: Log) -> None:
    for step in (Step.SCREWS_INSERTED, Step.ROBOT_REMOVED):
        log.add(StepRecorded(step, (), True, "why"))
    assert len(log.ledger.inside()) == 2
    log.add(StepRecorded(Step.FINISHED, (), True, "why"))
    assert log.ledger.inside() == ()


def test_events_are_taken_in_their_order(log: Log) -> None:
    with pytest.raises(ValueError, match="expected event 2, got event 4"):
        log.ledger.take(Event(4, 4, "case-1", "test", "", image("one")))


def test_a_case_is_not_opened_without_an_id() -> None:
    data = CaseOpened(samples.case_setup())
    with pytest.raises(ValueError, match="event 1 opens a case without an id"):
        opened_case(Event(1, 1, None, "test", "", data), data, UNSEEN)


def _frame(number: int) -> ImageReceived:
    return ImageReceived(samples.sha(f"frame {number}"), "1.2", 1, 1, None, "store", number, in_run=True)


def test_of_a_long_fluoroscopy_the_newest_frames_are_held_and_every_image_that_was_measured() -> None:
    log = Log(Ledger(images_held=8))
    log.add(CaseOpened(samples.case_setup()), image("shot"))
    for number in range(1, 101):
        case = log.add(_frame(number))
        if number == 5:
            case = log.add(localised(1, "frame 5"))
    names = [image.image_sha256 for image in case.images]
    assert names[:2] == [samples.sha("shot"), samples.sha("frame 5")]
    assert names[-8:] == [samples.sha(f"frame {number}") for number in range(93, 101)]
    assert len(names) <= 2 + 8 + 8 // 4
    assert case.frames_let_go + len(names) == 101
    assert 7 in log.ledger.images["store"]


def test_operations_that_go_on_are_known_in_the_order_in_which_they_began(approved: Log) -> None:
    running = OperationProgressed("one", OperationStatus.RUNNING, "")
    approved.add(asked_for("move", "one"), asked_for("move", "two"), running, asked_for("move", "three"))
    approved.add(ended("two", OperationStatus.STOPPED, began=True))
    after = approved.ledger.with_events([])
    for ledger in (approved.ledger, after):
        pending = ledger.pending_operations()
        assert [one.requested.operation_id for one in pending] == ["one", "three"]
        assert pending == tuple(one for one in ledger.operations.values() if not one.ended)
        assert pending[0].status is OperationStatus.RUNNING
