"""The stop path: straight to the robot, past every queue, lock and transaction of the gateway."""

import itertools
from dataclasses import dataclass

from shared.bus.keys import Keys
from shared.bus.port import Bus
from shared.errors import BusError
from shared.messages.base import MessageInvalid, decode, encode
from shared.messages.robot import CommandReply, MotionState, StopCommand

STOP_TIMEOUT_S = 1.0


@dataclass(frozen=True, slots=True)
class StopOutcome:
    """What came of a stop: confirmed when it was written and the controller showed standstill and brakes after it.

    `state` is the one that the robot service reported, None when it did not answer.
    """

    confirmed: bool
    state: MotionState | None
    message: str


class StopHandler:
    """Sends stops. `count` lets a command that is still waiting to be sent see that a stop came in between."""

    def __init__(self, bus: Bus, keys: Keys, client: str) -> None:
        self._bus = bus
        self._key = keys.robot_command("stop")
        self._client = client
        self._counter = itertools.count(1)
        self.count = 0

    def note_other(self) -> None:
        """Count a stop that another process of the gateway has sent."""
        self.count = next(self._counter)

    def stop(self, reason: str) -> StopOutcome:
        """Send a stop and wait for the robot's answer; nothing is written or locked before it is sent."""
        self.count = next(self._counter)
        command = encode(StopCommand(client=self._client, reason=reason))
        try:
            reply = decode(CommandReply, self._bus.query(self._key, command, STOP_TIMEOUT_S).payload)
        except (BusError, MessageInvalid) as error:
            return StopOutcome(
                confirmed=False,
                state=None,
                message=f"the stop was sent, but the robot did not confirm it: {error}; press the stop button on the "
                "controller",
            )
        return StopOutcome(reply.stop is not None and reply.stop.confirmed, reply.state, reply.message)
