"""Alarm conditions: each holds where it should, nowhere else, and the most urgent comes first."""

from dataclasses import replace
from itertools import pairwise, product

import pytest

from services.ui_api.core.alarms import PRIORITY, TABLE, AlarmSituation, Onset, Priority, Result, active_alarms
from services.ui_api.core.situation import Pending, RobotCondition

WELL = AlarmSituation(
    robot=RobotCondition.READY,
    pending=Pending.NOTHING,
    case_is_open=True,
    something_inside=False,
    side_agrees=True,
    lacks={},
)


@pytest.mark.requirement("GW-15")
@pytest.mark.parametrize(
    ("situation", "codes"),
    [
        (WELL, []),
        (replace(WELL, robot=RobotCondition.STALE, pending=Pending.MOVE), ["robot_lost_in_motion"]),
        (replace(WELL, robot=RobotCondition.DISCONNECTED, pending=Pending.REFERENCE), ["robot_lost_in_motion"]),
        (replace(WELL, robot=RobotCondition.UNDER_WAY, something_inside=True), ["motion_with_something_inside"]),
        (replace(WELL, robot=RobotCondition.UNDER_WAY), []),
        (replace(WELL, something_inside=True), []),
        (replace(WELL, robot=RobotCondition.FAULT), ["robot_fault"]),
        (replace(WELL, robot=RobotCondition.FAULT, case_is_open=False), ["robot_fault"]),
        (replace(WELL, robot=RobotCondition.ABSENT), ["robot_lost"]),
        (replace(WELL, robot=RobotCondition.ABSENT, case_is_open=False), []),
        (replace(WELL, side_agrees=False), ["other_side"]),
        (replace(WELL, robot=RobotCondition.BUTTON_PRESSED), ["stop_button"]),
        (replace(WELL, robot=RobotCondition.STOPPED), ["stop_in_force"]),
        (replace(WELL, robot=RobotCondition.STOPPED, case_is_open=False), []),
        (replace(WELL, lacks={"database": "locked"}), ["record_takes_nothing"]),
        (replace(WELL, lacks={"registration": "absent"}), ["imaging_impaired"]),
        (replace(WELL, lacks={"disk": "3 MiB are free"}), ["disk"]),
        (
            replace(WELL, robot=RobotCondition.FAULT, side_agrees=False, lacks={"disk": "full"}),
            ["other_side", "robot_fault", "disk"],
        ),
    ],
)
def test_a_condition_is_an_alarm_where_it_holds(situation: AlarmSituation, codes: list[str]) -> None:
    assert [alarm.condition.code for alarm in active_alarms(situation)] == codes


def test_what_was_measured_is_quoted() -> None:
    (alarm,) = active_alarms(replace(WELL, lacks={"disk": "3 MiB are free"}))
    assert alarm.measured == "disk: 3 MiB are free"


def test_priority_falls_neither_with_the_result_nor_with_the_onset() -> None:
    order = list(Priority)
    assert set(PRIORITY) == set(product(Result, Onset))
    for result in Result:
        assert all(order.index(PRIORITY[result, a]) <= order.index(PRIORITY[result, b]) for a, b in pairwise(Onset))
    for onset in Onset:
        assert all(order.index(PRIORITY[a, onset]) <= order.index(PRIORITY[b, onset]) for a, b in pairwise(Result))


def test_every_alarm_says_what_to_do() -> None:
    assert len({row.code for row in TABLE}) == len(TABLE)
    assert all(row.means and row.remedy for row in TABLE)
