"""An image says nothing of where the guide is once the guide moved, or may have."""

from dataclasses import replace

import pytest

from services.ui_api.core.event_data import (
    CaseOpened,
    SetupChanged,
    Step,
    StepRecorded,
    StepWithdrawn,
    VerificationMade,
)
from services.ui_api.core.events import Event, EventData
from services.ui_api.core.guide_moved import BY_A_CHANGED_SET_UP, BY_A_MOVE, BY_A_REFERENCE, BY_A_RESTART
from services.ui_api.core.procedure import Stage
from services.ui_api.core.robot_event_data import OperationStatus, RobotChanged
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.core.case_log import Log, asked_for, ended, image, plan

_ROBOT = RobotChanged("boot-1", "locked", "clear", True, True, None, "none", "", "a hexapod")


def _robot(state: str, boot_epoch: str = "boot-1") -> RobotChanged:
    return replace(_ROBOT, state=state, boot_epoch=boot_epoch)


def _unanswered(state: str, boot_epoch: str = "boot-1") -> RobotChanged:
    return replace(_robot(state, boot_epoch), locked=False, referenced=False)


def _verified(*names: str) -> VerificationMade:
    return VerificationMade(1, tuple(map(samples.sha, names)), "accepted", (), "e" * 64, ("distal",))


@pytest.fixture
def log() -> Log:
    """A case whose guide was verified in image "one", with the robot locked."""
    opened = Log()
    opened.add(CaseOpened(samples.case_setup()), _ROBOT, image("one", 1), _verified("one"))
    return opened


def test_a_guide_that_was_verified_stays_so_while_the_robot_holds_it(log: Log) -> None:
    case = log.add(_robot("stopped"), _robot("locked"))
    assert (case.progress.stage, case.guide_moved_since(samples.sha("one"))) == (Stage.VERIFIED, None)


@pytest.mark.requirement("GW-04")
@pytest.mark.parametrize(
    ("events", "because"),
    [
        ((_robot("fault"), _robot("stopped"), _robot("locked")), "the robot was in fault since it was taken"),
        ((_robot("disconnected"),), "the robot's controller was not connected since it was taken"),
        ((_robot("stopped", "boot-2"),), BY_A_RESTART),
        ((asked_for("reference", "op"), ended("op")), BY_A_REFERENCE),
        ((_robot("referencing"), _robot("locked")), BY_A_REFERENCE),
    ],
)
def test_what_nobody_watched_is_verified_anew(log: Log, events: tuple[EventData, ...], because: str) -> None:
    case = log.add(*events)
    assert (case.progress.stage, case.progress.seen) == (Stage.POSITIONING, False)
    assert case.guide_moved_since(samples.sha("one")) == because
    assert case.staleness_of_image(samples.sha("one"), 1) == because
    assert log.add(_verified("one")).progress.stage is Stage.POSITIONING
    assert log.add(image("two", 2), _verified("two")).progress.stage is Stage.VERIFIED


def test_a_reference_that_never_began_moved_nothing(log: Log) -> None:
    case = log.add(asked_for("reference", "op"), ended("op", OperationStatus.FAILED, began=False))
    assert (case.progress.stage, case.guide_moved) == (Stage.VERIFIED, None)


def test_an_image_that_came_while_the_robot_moved_shows_no_place_of_now(log: Log) -> None:
    log.add(plan(1, "one"), asked_for("move", "op"), image("under way", 2))
    case = log.add(ended("op"))
    assert case.progress.stage is Stage.ALIGNED
    assert case.guide_moved_since(samples.sha("under way")) == BY_A_MOVE
    assert log.add(_verified("under way")).progress.stage is Stage.ALIGNED


def test_a_motion_that_never_began_leaves_what_moved_the_guide_before(log: Log) -> None:
    moved = log.add(plan(1, "one"), asked_for("move", "op"), ended("op")).guide_moved
    assert moved is not None
    log.add(image("two", 2), asked_for("move", "op-2"))
    case = log.add(ended("op-2", OperationStatus.FAILED, began=False))
    assert case.guide_moved == moved
    assert case.guide_moved_since(samples.sha("one")) == BY_A_MOVE
    assert case.guide_moved_since(samples.sha("two")) is None


def test_a_fault_before_a_motion_that_never_began_is_not_forgotten(log: Log) -> None:
    log.add(plan(1, "one"), asked_for("move", "op"), _robot("fault"))
    case = log.add(ended("op", OperationStatus.FAILED, began=False))
    assert case.progress.stage is Stage.POSITIONING
    assert case.guide_moved_since(samples.sha("one")) == "the robot was in fault since it was taken"


def test_an_image_of_another_set_up_shows_no_place_of_now(log: Log) -> None:
    log.add(SetupChanged(2, samples.case_setup()), image("late", 2, revision=1))
    for name in ("one", "late"):
        assert log.case.guide_moved_since(samples.sha(name)) == BY_A_CHANGED_SET_UP
    assert log.add(_verified("one")).progress.stage is Stage.POSITIONING
    assert log.add(image("one", 3, revision=2), _verified("one")).progress.stage is Stage.POSITIONING, "sent again"
    assert log.add(image("two", 4, revision=2), _verified("two")).progress.stage is Stage.VERIFIED


def test_an_image_that_is_sent_again_is_from_when_it_came_first(log: Log) -> None:
    case = log.add(_robot("fault"), image("one", 3))
    assert case.guide_moved_since(samples.sha("one")) == "the robot was in fault since it was taken"


def test_images_without_numbers_are_from_before_when_they_were_known_then(log: Log) -> None:
    """Of records of older versions."""
    case = log.add(image("old"), _robot("fault"), image("new"))
    assert case.guide_moved_since(samples.sha("old")) == "the robot was in fault since it was taken"
    assert case.guide_moved_since(samples.sha("new")) is None


def test_an_image_that_was_missed_counts_by_its_number(log: Log) -> None:
    log.add(image("two", 4), _robot("fault"), image("missed", 3), image("three", 5))
    case = log.case
    assert case.guide_moved_since(samples.sha("missed")) == "the robot was in fault since it was taken"
    assert case.guide_moved_since(samples.sha("three")) is None


@pytest.mark.parametrize("state", ["fault", "disconnected", "referencing"])
def test_a_guide_is_watched_again_only_when_the_robot_holds_it(log: Log, state: str) -> None:
    log.add(_robot(state), image("meanwhile", 2), replace(_verified("meanwhile"), number=2))
    case = log.add(_robot("locked"))
    assert case.progress.stage is Stage.POSITIONING
    assert case.guide_moved_since(samples.sha("meanwhile")) is not None


def test_a_robot_that_has_lost_its_reference_was_not_watched(log: Log) -> None:
    case = log.add(replace(_robot("stopped"), referenced=False))
    assert case.guide_moved_since(samples.sha("one")) == "the robot was without a reference after it was taken"


@pytest.mark.requirement("GW-04")
@pytest.mark.parametrize("state", ["locked", "stopped"])
def test_a_controller_that_was_slow_to_answer_costs_no_image(log: Log, state: str) -> None:
    """The robot service watches: it makes a fault of a robot that is not where it was when the answer comes."""
    case = log.add(_robot(state), _unanswered(state), _robot("locked"))
    assert (case.progress.stage, case.guide_moved_since(samples.sha("one"))) == (Stage.VERIFIED, None)


@pytest.mark.requirement("GW-04")
@pytest.mark.parametrize(
    ("before", "unanswered"),
    [
        (_robot("fault"), _unanswered("stopped")),
        (replace(_robot("stopped"), referenced=False), _unanswered("stopped")),
        (_robot("stopped"), _unanswered("stopped", "boot-2")),
    ],
)
def test_a_controller_that_does_not_answer_ends_no_time_in_which_the_guide_was_not_watched(
    log: Log, before: RobotChanged, unanswered: RobotChanged
) -> None:
    log.add(before, unanswered, image("meanwhile", 2))
    case = log.add(_robot("locked", unanswered.boot_epoch))
    assert case.guide_moved_since(samples.sha("meanwhile")) is not None


def test_a_restart_is_noticed_in_a_case_that_was_opened_beside_a_robot_at_rest() -> None:
    log = Log()
    log.ledger.take(Event(1, 1, None, "robot", "", _ROBOT))
    log.add(CaseOpened(samples.case_setup()), image("one", 1), _verified("one"))
    assert log.case.progress.stage is Stage.VERIFIED
    log.add(asked_for("acknowledge_stop", "op"))  # by whom has seen the new run before its state is on record
    case = log.add(_robot("stopped", "boot-2"))
    assert (case.progress.stage, case.guide_moved_since(samples.sha("one"))) == (Stage.POSITIONING, BY_A_RESTART)


@pytest.mark.requirement("GW-04")
@pytest.mark.parametrize("step", [Step.DRILLED, Step.ROBOT_REMOVED])
@pytest.mark.parametrize("meanwhile", [_robot("fault"), SetupChanged(2, samples.case_setup()), None])
def test_a_step_that_is_withdrawn_gives_back_no_verification_from_before(
    log: Log, step: Step, meanwhile: EventData | None
) -> None:
    log.add(StepRecorded(step, (), False, ""), *(() if meanwhile is None else (meanwhile,)))
    case = log.add(StepWithdrawn(1, step))
    assert case.progress.stage is (Stage.VERIFIED if meanwhile is None else Stage.POSITIONING)
