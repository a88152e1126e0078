"""A gateway as it is installed, front and application, in this process; the services around it are scripted.

Requests are answered by the code that answers them in an installation, onto a record of its own. What is left out are
the other services: imaging and registration answer as told, and the robot is a state machine without a controller.
"""

import tempfile
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import count
from pathlib import Path
from typing import Final

from distalock.client import Client
from services.ui_api.core.roles import Role
from shared.bus.keys import Keys
from shared.bus.memory_bus import MemoryRouter
from shared.bus.port import Answer, Query
from shared.messages.base import decode, encode
from shared.messages.robot import CommandReply, MotionState, MoveCommand, PlainCommand, StopCommand, StopLatch
from tests.fuzz.site import OTHER_ACCOUNT, FuzzSite, ThereIs, abandon_open_cases, account_of
from tests.unit.services.ui_api.fakes import FakeRobot
from tests.unit.services.ui_api.people import add_account
from tests.unit.services.ui_api.room import TOKEN, Room, open_room_with

_MOVES_FOR_S: Final = 0.2
_STATE_EVERY_S: Final = 0.5
_AFTER: Final = {
    "acknowledge_stop": (MotionState.STOPPED, MotionState.LOCKED),
    "reference": (MotionState.UNREFERENCED, MotionState.LOCKED),
    "reset": (MotionState.FAULT, MotionState.STOPPED),
}


class SimulatedRobot(FakeRobot):
    """Goes through the states of a robot as it is told to, and moves for a moment."""

    def __init__(self, router: MemoryRouter, keys: Keys) -> None:
        self._one_at_a_time = threading.RLock()
        self._ended = threading.Event()
        super().__init__(router, keys)
        self.answers_moves = self._begin_move
        self._publishing = threading.Thread(target=self._publish, daemon=True)
        self._publishing.start()

    def leave(self) -> None:
        """Publish no more."""
        self._ended.set()
        self._publishing.join()

    def _publish(self) -> None:
        while not self._ended.wait(_STATE_EVERY_S):
            with self._one_at_a_time:
                self.say(self.state.state)

    def _begin_move(self, command: MoveCommand) -> CommandReply:
        with self._one_at_a_time:
            reply = self._accept_move(command)
        threading.Timer(_MOVES_FOR_S, self._arrive, (command.envelope.command_id,)).start()
        return reply

    def _arrive(self, command_id: str) -> None:
        with self._one_at_a_time:
            if self.state.state is MotionState.MOVING and self.state.command_id == command_id:
                self.arrive()

    def _plain(self, query: Query) -> Answer:
        command = decode(PlainCommand, query.payload)
        before, after = _AFTER[command.verb]
        with self._one_at_a_time:
            fits = self.state.state is before
            if fits:
                moved = {"command_id": command.envelope.command_id, "outcome": "reached"}
                latch = StopLatch.LATCHED if after is MotionState.STOPPED else StopLatch.CLEAR
                self.say(after, stop=latch, **(moved if command.verb == "reference" else {}))
            state = self.state.state
        command_id = command.envelope.command_id
        if fits:
            return Answer(encode(CommandReply(command_id=command_id, verdict="accepted", state=state)))
        refused = CommandReply(
            command_id=command_id,
            verdict="refused",
            code="nothing_to_do",
            message=f"'{command.verb}' is not possible in the state '{state}'",
            state=state,
        )
        return Answer(encode(refused))

    def _stop(self, query: Query) -> Answer:
        decode(StopCommand, query.payload)
        with self._one_at_a_time:
            outcome = "stopped" if self.state.state is MotionState.MOVING else self.state.outcome
            self.say(MotionState.STOPPED, stop=StopLatch.LATCHED, outcome=outcome)
        return Answer(encode(self.answers_stops))


@contextmanager
def gateway_site() -> Iterator[FuzzSite]:
    """Start the gateway; gone afterwards."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="distalock-fuzz-")))
        room = stack.enter_context(
            open_room_with(SimulatedRobot, folder, requests_per_s=0.0, requests_per_address_per_s=0.0)
        )
        robot = room.robot
        assert isinstance(robot, SimulatedRobot)
        stack.callback(robot.leave)
        client = stack.enter_context(Client(str(room.client.base_url), TOKEN))
        for role in Role:
            add_account(room, account_of(role), role)
        add_account(room, OTHER_ACCOUNT, Role.VIEWER)
        numbers = count(1)

        def fresh_case() -> ThereIs:
            abandon_open_cases(client)
            return _with_case(room, folder, next(numbers))

        yield FuzzSite(str(room.client.base_url).rstrip("/"), TOKEN, fresh_case)


def _with_case(room: Room, folder: Path, number: int) -> ThereIs:
    with_robot = room.post("/robot/stop")
    assert with_robot.status_code == 200, with_robot.text
    acknowledged = room.post("/robot/acknowledge-stop").json()
    case_id = room.open_case()
    image = room.image(f"of case {number}", case_id)
    _store(folder / "images", image.sha256)
    plan = room.post(f"/cases/{case_id}/plans", {"localisation": 1, "hole_ids": ["distal"]})
    assert plan.status_code == 201, plan.text
    known: dict[str, object] = {
        "case_id": case_id,
        "image_id": image.sha256,
        "number": 1,
        "operation_id": acknowledged["id"],
        "name": "ring-120",
    }
    return ThereIs(known, plan.headers["etag"])


def _store(images: Path, sha256: str) -> None:
    """The image's file, as imaging leaves it."""
    file = images / sha256[:2] / f"{sha256}.dcm"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(b"DICM")
