"""Whatever it takes until the robot is locked and may move: what a person does at the console after a fault."""

import time
from collections.abc import Callable, Mapping
from typing import Final

from distalock.client import Client
from distalock.client.models import OperationView

# An operation of which nothing more will come.
ENDED: Final = frozenset({"succeeded", "failed", "stopped", "cancelled"})
_POLL_S: Final = 0.05
_READY_WITHIN_S: Final = 60.0
# An image that is taken sooner is bound to no pose of the robot.
_SETTLES_S: Final = 1.0
_COMMANDS: Final[Mapping[str, Callable[[Client], OperationView]]] = {
    "stopped": Client.acknowledge_stop,
    "unreferenced": Client.reference_robot,
    "fault": Client.reset_robot,
    "disconnected": Client.reset_robot,
}


class NotDone(Exception):
    """An action had no success, for the reason given."""


def make_robot_ready(rest: Client, settles_s: float = _SETTLES_S) -> None:
    """Acknowledge, reference, reset, until it is locked; then wait until an image may be taken.

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
        view = rest.read_robot()
        state = view.state
        if view.validity != "current" or state is None:
            time.sleep(_POLL_S)
            continue
        if state.state == "locked" and state.locked is True:
            time.sleep(0.0 if last is None else settles_s)
            return
        command = _COMMANDS.get(state.state)
        if command is not None:
            last = _ended(rest, command(rest))
        time.sleep(_POLL_S)
    raise NotDone(f"the robot is not ready after {_READY_WITHIN_S:g} s: {state}; {last}")


def _ended(rest: Client, operation: OperationView) -> str:
    deadline_s = time.monotonic() + _READY_WITHIN_S
    while operation.status not in ENDED and time.monotonic() < deadline_s:
        time.sleep(_POLL_S)
        operation = rest.read_operation(operation.id)
    return operation.detail
