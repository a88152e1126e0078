"""`GET /alarms` says what is to be responded to, by priority."""

import time
from typing import TypedDict

import pytest

from shared.messages.robot import MotionState
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.room import Room


class Item(TypedDict):
    code: str
    measured: str
    remedy: str


class Alarms(TypedDict):
    highest: str | None
    items: list[Item]


def _wait_for(room: Room, codes: list[str]) -> Alarms:
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        answer: Alarms = room.client.get("/api/v1/alarms").json()
        if [item["code"] for item in answer["items"]] == codes:
            return answer
        assert time.monotonic() < deadline_s, answer
        time.sleep(0.05)


@pytest.mark.requirement("GW-15")
def test_a_fault_is_an_alarm_until_it_has_gone(room: Room) -> None:
    assert _wait_for(room, [])["highest"] is None
    room.robot.say(MotionState.FAULT)
    answer = _wait_for(room, ["robot_fault"])
    assert answer["highest"] == "medium"
    assert "robot_state: fault" in answer["items"][0]["measured"]
    assert "reset" in answer["items"][0]["remedy"]
    room.robot.say(MotionState.LOCKED)
    _wait_for(room, [])
