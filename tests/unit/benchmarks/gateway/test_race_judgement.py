"""The judge of races notices each kind of fault."""

from dataclasses import replace

import pytest

from benchmarks.gateway.race_judgement import Answer, Commanded, MoveOperation, Race, Recorded, faults_of, record_faults
from benchmarks.gateway.race_room import OverheardLine

APPROVED = Answer("anna", "approve", "k1", 201, "", "", "{}")
MOVED = Answer("anna", "move", "k2", 202, "", "", "{}")
REFUSED = Answer("boris", "move", "k3", 409, "plan_stale", "a motion was made from it", "{}")
STOPPED = Answer("boris", "stop", "", 200, "", "", "{}")
MOVE, STOP = Commanded(1.0, "move"), Commanded(2.0, "stop")
BEGAN = MoveOperation("op1", ended=True, began=True)
GOOD = Race((APPROVED, MOVED, REFUSED, STOPPED), (MOVE, STOP), (BEGAN,), latched=True, at_rest=True)
CODES = {"plan_stale"}


def test_a_race_that_a_stop_won_is_fine() -> None:
    assert faults_of(GOOD, CODES) == []


@pytest.mark.parametrize(
    ("race", "said"),
    [
        (replace(GOOD, commanded=(MOVE, MOVE, STOP)), "2 motions went to the controller for one plan"),
        (replace(GOOD, operations=()), "1 motions went to the controller, and 0 operations"),
        (replace(GOOD, operations=(replace(BEGAN, ended=False),)), "operation op1 has not ended"),
        (replace(GOOD, commanded=(STOP, Commanded(3.0, "move"))), "a motion went to the controller after a stop"),
        (replace(GOOD, commanded=(MOVE,)), "no stop byte went to the controller"),
        (replace(GOOD, latched=False), "the robot is not at rest with the stop in force"),
        (replace(GOOD, at_rest=False), "the robot is not at rest with the stop in force"),
        (
            replace(GOOD, answers=(replace(STOPPED, status=504, code="stop_not_confirmed"),)),
            "boris: stop was answered 504",
        ),
        (replace(GOOD, answers=(replace(REFUSED, status=500),)), "boris: move was answered 500"),
        (replace(GOOD, answers=(replace(REFUSED, code="nowhere"),)), "on no page, or without a reason"),
        (replace(GOOD, answers=(replace(REFUSED, detail=""),)), "on no page, or without a reason"),
        (
            replace(GOOD, answers=(APPROVED, replace(APPROVED, status=409))),
            "the repeat of approve was answered 409, not 201",
        ),
    ],
)
def test_each_fault_is_noticed(race: Race, said: str) -> None:
    assert any(said in fault for fault in faults_of(race, CODES)), faults_of(race, CODES)


def test_a_motion_that_a_stop_ended_before_its_command_has_begun_all_the_same() -> None:
    """Servos are on and brakes off before the controller is told where to go."""
    assert faults_of(replace(GOOD, commanded=(STOP,)), CODES) == []


def test_the_record_has_what_was_answered_and_nothing_else() -> None:
    approved, asked = Recorded("plan_approved", 1), Recorded("operation_requested", 1, "move")
    stopped, withdrawn = Recorded("stop_requested", None), Recorded("approval_withdrawn", 1)
    answers = (APPROVED, APPROVED, MOVED, REFUSED, STOPPED)
    assert record_faults([approved, asked, stopped], answers) == []
    assert record_faults([asked, stopped, approved], answers) == [
        "a motion from plan 1 is on record, which nobody had approved then"
    ]
    assert "1 times approve was answered with success, and the record has 0" in record_faults([asked, stopped], answers)
    faults = record_faults([approved, withdrawn, asked, stopped], answers)
    assert "0 times undo was answered with success, and the record has 1" in faults


def test_a_stop_is_heard_in_the_middle_of_a_line() -> None:
    line = OverheardLine()
    for piece in (b"POS? X\nMO", b"V X 1.0\n\x05", b"MOV X\x18 2.0", b"\nVEL 1\n"):
        line.hear(piece)
    assert [one.what for one in line.taken()] == ["move", "stop", "move"]
    assert line.taken() == ()
