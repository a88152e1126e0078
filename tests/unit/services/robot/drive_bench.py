"""The drive on a controller without a line, one round of work at a time."""

from collections.abc import Callable

from services.robot.core.guard import PermittedMove
from services.robot.core.refusals import Refusal
from services.robot.core.tuning import SUPERVISION
from services.robot.devices.guardian import Unguarded
from services.robot.drive.drive import Drive
from shared.errors import DeviceError
from shared.geometry.hexapod import ZERO_POSE, PlatformPose
from shared.robot_states import MotionState
from tests.unit.services.robot.fake_controller import FakeController

TARGET = PlatformPose(2.0, 0.0, 0.0, 0.0, 0.0, 0.0)
MOVE = PermittedMove("a" * 64, ZERO_POSE, TARGET, 2.0, 1.0)


class FakeGuardian(Unguarded):
    """One that may be lost."""

    def __init__(self) -> None:
        self.reason = ""

    def lost(self) -> str:
        """Why nothing may move."""
        return self.reason


class Bench:
    """A drive, its controller and its clock."""

    def __init__(self) -> None:
        self.controller = FakeController()
        self.reachable = True
        self.now_s = 50.0
        self.crashes: list[str] = []
        self.guardian = FakeGuardian()
        self.drive = Drive(
            self._connect,
            SUPERVISION.read_back,
            lambda: self.now_s,
            1.0,
            self.crashes.append,
            guardian=self.guardian,
        )

    def _connect(self) -> FakeController:
        if not self.reachable:
            raise DeviceError("the controller cannot be reached; check its cable")
        return self.controller

    def has(self, state: MotionState) -> bool:
        return self.drive.status.state is state

    def work(self, rounds: int = 2) -> None:
        for _ in range(rounds):
            self.drive.step()

    def after_the_next_round(self, happens: Callable[[], object]) -> None:
        """Let something happen after the controller has answered once more, before the answers are taken in."""

        def once() -> None:
            self.controller.after_read = lambda: None
            happens()

        self.controller.after_read = once

    @property
    def outcome(self) -> str:
        return self.drive.status.outcome

    def make_ready(self) -> None:
        self.work()
        assert self.drive.acknowledge_stop() is None
        self.work()
        assert self.drive.begin_reference("r1") is None
        self.work()
        assert self.has(MotionState.LOCKED)

    def begin_move(self) -> Refusal | None:
        return self.drive.begin_move("m1", lambda _: MOVE)

    def start_move(self) -> None:
        self.make_ready()
        assert self.begin_move() is None
        self.work(1)
        assert self.controller.feedback.unlocked
