"""What robot states say about commands."""

from dataclasses import replace

import pytest

from services.ui_api.core.operations import Operation, RobotSaying, settle
from services.ui_api.core.robot_event_data import (
    OperationEnded,
    OperationProgressed,
    OperationRequested,
    OperationStatus,
)

_CLOCK_S = 5.0
_REQUESTED = OperationRequested(
    operation_id="op",
    verb="move",
    plan_number=1,
    plan_sha256="a" * 64,
    hold_to_move=False,
    robot_boot_epoch="robot-1",
    after_state_sequence=10,
    state_sent_at_ns=5_000_000_000,
    previous_command_id="before",
    time_to_live_s=1.0,
    state_clock_s=_CLOCK_S,
)
_UNKNOWN = Operation(_REQUESTED, "case-1", 0, OperationStatus.UNKNOWN)
_RUNNING = Operation(_REQUESTED, "case-1", 0, OperationStatus.RUNNING, began=True)
_ACKNOWLEDGE = replace(_UNKNOWN, requested=replace(_REQUESTED, verb="acknowledge_stop"))
_SAYING = RobotSaying(
    boot_epoch="robot-1",
    sequence=11,
    clock_s=_CLOCK_S + 0.1,
    command_id="op",
    outcome="moving",
    at_rest=False,
    stop_latched=False,
    in_fault=False,
    detail="",
    deviation_mm=None,
    deviation_deg=None,
)
_LATE = replace(_SAYING, clock_s=_CLOCK_S + 2.1, at_rest=True, outcome="none")


def test_an_unanswered_command_is_running_when_the_robot_says_so() -> None:
    assert settle(_UNKNOWN, _SAYING) == OperationProgressed("op", OperationStatus.RUNNING, "")
    assert settle(_RUNNING, _SAYING) is None


@pytest.mark.parametrize(
    ("outcome", "status", "code"),
    [
        ("reached", OperationStatus.SUCCEEDED, ""),
        ("stopped", OperationStatus.STOPPED, "motion_stopped"),
        ("failed", OperationStatus.FAILED, "motion_failed"),
    ],
)
@pytest.mark.parametrize("operation", [_UNKNOWN, _RUNNING], ids=["unknown", "running"])
def test_an_outcome_ends_the_operation(operation: Operation, outcome: str, status: OperationStatus, code: str) -> None:
    said = replace(_SAYING, outcome=outcome, at_rest=True, deviation_mm=0.1, deviation_deg=0.2, detail="there")
    assert settle(operation, said) == OperationEnded("op", status, True, code, "there", 0.1, 0.2)


def test_an_outcome_does_not_count_before_the_robot_is_at_rest() -> None:
    assert settle(_RUNNING, replace(_SAYING, outcome="reached", at_rest=False)) is None


def test_states_from_before_the_command_say_nothing() -> None:
    assert settle(_UNKNOWN, replace(_SAYING, sequence=10, outcome="reached", at_rest=True)) is None


def test_a_command_is_not_executed_once_the_robot_refuses_it_by_its_own_clock() -> None:
    untouched = replace(_SAYING, command_id="before", at_rest=True)
    assert settle(_UNKNOWN, untouched) is None
    ended = settle(_UNKNOWN, replace(_LATE, command_id="before"))
    assert isinstance(ended, OperationEnded)
    assert (ended.status, ended.began, ended.code) == (OperationStatus.FAILED, False, "not_executed")
    assert "within its 1 s" in ended.message


def test_a_command_that_the_robot_accepted_is_never_called_not_executed() -> None:
    assert settle(_RUNNING, replace(_LATE, command_id="before")) is None


def test_another_command_in_its_place_means_that_the_end_was_not_seen() -> None:
    ended = settle(_RUNNING, replace(_LATE, command_id="other"))
    assert isinstance(ended, OperationEnded)
    assert (ended.began, ended.code) == (True, "outcome_not_seen")


def test_a_restarted_robot_ends_nothing_before_its_controller_was_stopped() -> None:
    assert settle(_RUNNING, replace(_SAYING, boot_epoch="robot-2", sequence=0, connected=False)) is None


def test_a_restarted_robot_ends_what_was_under_way_as_not_known() -> None:
    ended = settle(_RUNNING, replace(_SAYING, boot_epoch="robot-2", sequence=0))
    assert isinstance(ended, OperationEnded)
    assert (ended.status, ended.began, ended.code) == (OperationStatus.FAILED, True, "robot_restarted")


@pytest.mark.parametrize(
    ("after", "status"),
    [
        (replace(_LATE, command_id="before"), OperationStatus.SUCCEEDED),
        (replace(_LATE, command_id="before", stop_latched=True), OperationStatus.FAILED),
    ],
    ids=["released", "still latched"],
)
def test_a_command_without_a_motion_is_settled_by_its_effect(after: RobotSaying, status: OperationStatus) -> None:
    assert settle(_ACKNOWLEDGE, replace(_SAYING, command_id="before")) is None
    ended = settle(_ACKNOWLEDGE, after)
    assert isinstance(ended, OperationEnded)
    # Also where a stop is in force: another one may have come since this was acknowledged.
    assert (ended.status, ended.began) == (status, True)


def test_without_the_robots_clock_nothing_is_called_too_late() -> None:
    untouched = replace(_LATE, command_id="before")
    assert settle(_UNKNOWN, replace(untouched, clock_s=None)) is None
    of_older_version = replace(_UNKNOWN, requested=replace(_REQUESTED, state_clock_s=None))
    assert settle(of_older_version, untouched) is None
