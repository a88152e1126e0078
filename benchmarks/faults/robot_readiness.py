"""Whatever it takes until the robot is locked and may move: what a person does at the console after a fault."""

import time
from typing import Final

from distalock.case_client import Operation
from distalock.rest_client import JsonObject, RestClient

_POLL_S: Final = 0.05
_READY_WITHIN_S: Final = 60.0
# An image that is taken sooner is bound to no pose of the robot.
_SETTLES_S: Final = 1.0
_COMMANDS: Final = {
    "stopped": "acknowledge-stop",
    "unreferenced": "reference",
    "fault": "reset",
    "disconnected": "reset",
}


class NotDone(Exception):
    """An action had no success, for the reason given."""


def make_robot_ready(rest: RestClient) -> None:
    """Acknowledge, reference, reset, until it is locked.

    Raises
    ------
    NotDone
        When that takes longer than a minute.
    RequestRefused
        When a command is refused.
    """
    deadline_s = time.monotonic() + _READY_WITHIN_S
    last: str | None = None
    while time.monotonic() < deadline_s:
        view = rest.get("/api/v1/robot")
        state = view["state"]
        if view["validity"] != "current" or not isinstance(state, dict):
            time.sleep(_POLL_S)
            continue
        if state["state"] == "locked" and state["locked"] is True:
            time.sleep(0.0 if last is None else _SETTLES_S)
            return
        command = _COMMANDS.get(str(state["state"]))
        if command is not None:
            last = _ended(rest, rest.post(f"/api/v1/robot/{command}"))
        time.sleep(_POLL_S)
    raise NotDone(f"the robot is not ready after {_READY_WITHIN_S:g} s: {state}; {last}")


def _ended(rest: RestClient, begun: JsonObject) -> str:
    deadline_s = time.monotonic() + _READY_WITHIN_S
    operation = Operation.model_validate(begun)
    while not operation.ended and time.monotonic() < deadline_s:
        time.sleep(_POLL_S)
        operation = Operation.model_validate(rest.get(f"/api/v1/operations/{operation.id}"))
    return operation.detail
