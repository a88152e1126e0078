"""Whatever happens, in whatever order: no motion without a permitted move, none after a stop, and locked in the end."""

from dataclasses import replace

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from services.robot.core.controller_feedback import ControllerError
from services.robot.core.guard import PermittedMove
from services.robot.core.motion import stop_is_latched
from services.robot.core.refusals import Refusal, RefusalCode
from services.robot.core.tuning import SUPERVISION
from services.robot.drive.drive import Drive
from shared.geometry.hexapod import ZERO_POSE, PlatformPose
from shared.robot_states import MotionState
from tests.unit.services.robot.fake_controller import AT_REST, FAULT, STOPPED, FakeController

TARGET = PlatformPose(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
REFUSED = Refusal(RefusalCode.PLAN_STALE, "stale")


class DriveUnderAnything(RuleBasedStateMachine):
    """Commands, faults and rounds of work in any order, on the drive as it is."""

    @initialize()
    def start(self) -> None:
        self.now_s = 0.0
        self.controller = FakeController()
        self.permitted: list[PlatformPose] = []
        self.crashes: list[str] = []
        self.drive = Drive(self._connect, SUPERVISION.read_back, lambda: self.now_s, 1.0, self.crashes.append)

    def _connect(self) -> FakeController:
        self.controller.closed = False
        self.controller.stop_now()
        return self.controller

    @rule(rounds=st.integers(1, 3), pause_s=st.floats(0.0, 0.3))
    def work(self, rounds: int, pause_s: float) -> None:
        for _ in range(rounds):
            self.now_s += pause_s
            self.drive.step()

    @rule()
    def permitted_move(self) -> None:
        start = self.controller.feedback.pose
        target = PlatformPose(1.0 - start.x_mm, 0.0, 0.0, 0.0, 0.0, 0.0)
        stopped_before = stop_is_latched(self.drive.status.state)
        refusal = self.drive.begin_move("m", lambda _: PermittedMove("a" * 64, start, target, 2.0, 0.5))
        if refusal is None:
            assert not stopped_before
            self.permitted.append(target)

    @rule()
    def refused_move(self) -> None:
        assert self.drive.begin_move("m", lambda _: REFUSED) is not None

    @rule()
    def stop(self) -> None:
        self.drive.stop("somebody")
        assert not self.controller.feedback.moving
        assert self.drive.status.state not in (MotionState.MOVING, MotionState.REFERENCING, MotionState.LOCKED)

    @rule()
    def lose_supervision(self) -> None:
        self.drive.supervision_lost("silent")
        assert self.drive.status.state not in (MotionState.MOVING, MotionState.REFERENCING)

    @rule()
    def arrive(self) -> None:
        self.controller.arrive()

    @rule()
    def arrive_elsewhere(self) -> None:
        self.controller.arrive(PlatformPose(5.0, 5.0, 0.0, 0.0, 0.0, 0.0))

    @rule()
    def reference(self) -> None:
        self.drive.begin_reference("r")

    @rule()
    def acknowledge(self) -> None:
        if self.drive.acknowledge_stop() is None:
            self.drive.step()
            assert self.controller.feedback.locked or self.drive.status.state is MotionState.FAULT

    @rule()
    def reset(self) -> None:
        self.drive.reset()

    @rule(count=st.integers(1, 3))
    def controller_fails(self, count: int) -> None:
        self.controller.failures += ["the controller is silent"] * count

    @rule(error=st.sampled_from([FAULT, STOPPED]))
    def controller_reports_error(self, error: ControllerError) -> None:
        self.controller.feedback = replace(self.controller.feedback, error=error)

    @rule()
    def controller_button(self) -> None:
        self.controller.stop_now()
        self.controller.stopped = stop_is_latched(self.drive.status.state)

    @rule()
    def power_cycle(self) -> None:
        self.controller.feedback = replace(AT_REST, pose=self.controller.feedback.pose)

    @rule()
    def brakes_jam(self) -> None:
        self.controller.brakes_hold = False

    @rule()
    def brakes_work_again(self) -> None:
        self.controller.brakes_hold = True

    @rule()
    def a_brake_lets_go(self) -> None:
        self.controller.feedback = replace(self.controller.feedback, locked=False)

    @invariant()
    def nothing_moved_that_was_not_permitted(self) -> None:
        assert self.controller.motions == self.permitted[: len(self.controller.motions)] or all(
            motion in self.permitted for motion in self.controller.motions
        )
        assert len(self.controller.motions) <= len(self.permitted)

    @invariant()
    def motion_only_in_the_states_that_move(self) -> None:
        if self.controller.feedback.moving:
            assert self.drive.status.state is MotionState.MOVING

    @invariant()
    def the_latch_of_the_state_is_the_latch_of_the_driver(self) -> None:
        if stop_is_latched(self.drive.status.state):
            assert self.controller.stopped

    @invariant()
    def nothing_crashed(self) -> None:
        assert self.crashes == []

    def teardown(self) -> None:
        if not hasattr(self, "drive"):
            return
        self.controller.failures.clear()
        self.controller.brakes_hold = True
        # A robot that the service has no line to cannot be locked by it: let it connect first.
        self.drive.step()
        self.drive.step()
        self.drive.leave()
        while self.drive.step():
            pass
        assert self.controller.feedback.locked
        assert not self.controller.feedback.moving
        assert self.drive.status.state is MotionState.DISCONNECTED


TestDriveUnderAnything = DriveUnderAnything.TestCase
TestDriveUnderAnything.settings = settings(max_examples=150, stateful_step_count=40, deadline=None)


class DriveThatIsNotLeft(DriveUnderAnything):
    """The same, but ended by a stop instead of leaving: at rest and locked after the worker's next rounds."""

    def teardown(self) -> None:
        if not hasattr(self, "drive"):
            return
        self.controller.failures.clear()
        self.controller.brakes_hold = True
        self.drive.stop("the end")
        for _ in range(4):
            self.now_s += 0.1
            self.drive.step()
        assert self.controller.feedback.locked
        assert stop_is_latched(self.drive.status.state)


TestDriveThatIsNotLeft = DriveThatIsNotLeft.TestCase
TestDriveThatIsNotLeft.settings = settings(max_examples=150, stateful_step_count=40, deadline=None)


def test_the_zero_pose_is_where_the_fake_starts() -> None:
    assert FakeController().feedback.pose == ZERO_POSE
