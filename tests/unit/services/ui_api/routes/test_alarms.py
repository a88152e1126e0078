"""`GET /alarms` says what is to be responded to, by priority."""

import time

import pytest

from shared.messages.robot import MotionState
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.room import Room


def _wait_for(room: Room, code: str) -> dict[str, object]:
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        answer: dict[str, object] = room.client.get("/api/v1/alarms").json()
        items = answer["items"]
        assert isinstance(items, list)
        if [item["code"] for item in items] == ([code] if code else []):
            return answer
        assert time.monotonic() < deadline_s, answer
        time.sleep(0.05)


@pytest.mark.requirement("GW-15")
def test_a_fault_is_an_alarm_until_it_has_gone(room: Room) -> None:
    assert _wait_for(room, "")["highest"] is None
    room.robot.say(MotionState.FAULT)
    answer = _wait_for(room, "robot_fault")
    assert answer["highest"] == "medium"
    (alarm,) = answer["items"]  # type: ignore[misc]  # a list, as above
    assert "robot_state: fault" in alarm["measured"]
    assert "reset" in alarm["remedy"]
    room.robot.say(MotionState.LOCKED)
    _wait_for(room, "")
