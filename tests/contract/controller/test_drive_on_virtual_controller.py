"""The drive on a virtual controller: the whole way from a request to a locked guide, and every fault."""

import time
from collections.abc import Callable, Iterator

import pytest

from services.robot.core.deviation import deviation
from services.robot.core.guard import PermittedMove
from services.robot.core.refusals import RefusalCode
from services.robot.core.status import DriveStatus
from services.robot.core.tuning import SUPERVISION
from services.robot.devices.gcs.controller import GcsController
from services.robot.devices.serial_port import open_port
from services.robot.drive.drive import Drive
from shared.geometry.hexapod import ZERO_POSE, PlatformPose
from shared.robot_states import MotionState, StopButton
from simulation.controller.faults import Fault
from simulation.controller.servers import tcp_server
from simulation.controller.virtual_controller import VirtualController
from tests.contract.controller.lines import FAR, HEXAPOD, NEAR, WAIT_S, wait_until

# pyserial's RFC 2217 names its thread in a way that Python 3.10 deprecated.
pytestmark = pytest.mark.filterwarnings("ignore:set(Daemon|Name)\\(\\) is deprecated:DeprecationWarning")


@pytest.fixture
def drive(url: str) -> Iterator[Drive]:
    def connect() -> GcsController:
        return GcsController(open_port(url, 115200), HEXAPOD)

    crashes: list[str] = []
    made = Drive(connect, SUPERVISION.read_back, time.monotonic, 0.1, crashes.append)
    made.start()
    yield made
    made.close()
    assert crashes == []


def reach(drive: Drive, condition: Callable[[DriveStatus], bool]) -> DriveStatus:
    deadline = time.monotonic() + WAIT_S
    status = drive.status
    while not condition(status):
        assert time.monotonic() < deadline, f"not reached in time: {status}"
        status = drive.wait_for_change(status, 0.1)
    return status


def make_ready(drive: Drive) -> None:
    reach(drive, lambda s: s.state is MotionState.STOPPED and s.fresh_feedback(time.monotonic()) is not None)
    assert drive.acknowledge_stop() is None
    reach(drive, lambda s: s.state is MotionState.UNREFERENCED and s.fresh_feedback(time.monotonic()) is not None)
    assert drive.begin_reference("r1") is None
    reach(drive, lambda s: s.state is MotionState.LOCKED and s.outcome == "reached")


def begin(drive: Drive, target: PlatformPose, seconds: float) -> None:
    def permit(_: DriveStatus) -> PermittedMove:
        return PermittedMove("a" * 64, ZERO_POSE, target, 2.0, seconds)

    assert drive.begin_move("m1", permit) is None


def is_locked(status: DriveStatus) -> bool:
    feedback = status.fresh_feedback(time.monotonic())
    return feedback is not None and feedback.locked


def test_the_drive_moves_to_a_target_and_locks(drive: Drive, virtual: VirtualController) -> None:
    make_ready(drive)
    begin(drive, NEAR, 0.2)
    status = reach(drive, lambda s: s.state is MotionState.LOCKED and s.deviation is not None)
    assert status.outcome == "reached"
    snapshot = virtual.snapshot()
    assert snapshot.brake_on
    assert not snapshot.servo_on
    assert not snapshot.was_unheld
    assert not deviation(NEAR, snapshot.measured_pose).exceeds(SUPERVISION.read_back)


def test_the_drive_stops_within_a_fifth_of_a_second(drive: Drive, virtual: VirtualController) -> None:
    make_ready(drive)
    begin(drive, FAR, 3.0)
    wait_until(lambda: virtual.snapshot().moving)
    asked_s = time.monotonic()
    drive.stop("test")
    wait_until(lambda: virtual.snapshot().brake_on and not virtual.snapshot().servo_on)
    assert time.monotonic() - asked_s < 0.2
    status = reach(drive, is_locked)
    assert (status.state, status.outcome) == (MotionState.STOPPED, "stopped")


# What kind of line it is does not matter to faults of the controller: two kinds will do.
@pytest.mark.requirement("ROB-08")
@pytest.mark.parametrize("url", ["tcp", "pty"], indirect=True)
@pytest.mark.parametrize(
    ("fault", "state", "words"),
    [
        (Fault.SILENCE, MotionState.FAULT, "silent"),
        (Fault.GARBAGE_REPLY, MotionState.FAULT, "not an answer"),
        (Fault.PARTIAL_REPLY, MotionState.FAULT, "silent|not an answer"),
        (Fault.ECHO, MotionState.FAULT, "not an answer"),
        (Fault.SLOW_REPLY, MotionState.FAULT, "silent"),
        (Fault.LIMIT_SWITCH, MotionState.FAULT, "limit switch|lost during"),
        (Fault.ENCODER_JUMP, MotionState.FAULT, "beside its path"),
        (Fault.POWER_CYCLE, MotionState.FAULT, "silent"),
        (Fault.LEG_STALL, MotionState.FAULT, "beside its path|motion error|does not call it reached|lost during"),
        (Fault.SERVO_ERROR, MotionState.FAULT, "motion error"),
        (Fault.EMERGENCY_STOP, MotionState.STOPPED, "stop button is pressed"),
    ],
)
def test_every_fault_ends_a_move(
    drive: Drive, virtual: VirtualController, fault: Fault, state: MotionState, words: str
) -> None:
    make_ready(drive)
    begin(drive, FAR, 3.0)
    wait_until(lambda: virtual.snapshot().moving)
    virtual.inject(fault)
    status = reach(drive, lambda s: s.state is not MotionState.MOVING)
    assert status.state is state
    assert any(word in status.detail for word in words.split("|")), status.detail
    virtual.clear(fault)
    wait_until(lambda: virtual.snapshot().brake_on and not virtual.snapshot().servo_on)


@pytest.mark.requirement("ROB-12")
def test_a_brake_that_slips_is_noticed_at_rest(drive: Drive, virtual: VirtualController) -> None:
    make_ready(drive)
    reach(drive, lambda s: s.held is not None)
    virtual.inject(Fault.BRAKE_SLIPS)
    status = reach(drive, lambda s: s.state is MotionState.FAULT)
    assert "the locked robot has moved by 0.300 mm" in status.detail
    virtual.clear(Fault.BRAKE_SLIPS)


@pytest.mark.requirement("ROB-17")
def test_after_a_power_cycle_nothing_moves_before_reset_acknowledgement_and_reference(
    drive: Drive, virtual: VirtualController
) -> None:
    make_ready(drive)
    virtual.inject(Fault.POWER_CYCLE)
    reach(drive, lambda s: s.state is MotionState.FAULT)
    virtual.clear(Fault.POWER_CYCLE)
    refusal = drive.begin_move("m1", lambda _: PermittedMove("a" * 64, ZERO_POSE, NEAR, 2.0, 0.2))
    assert refusal is not None
    assert refusal.code is RefusalCode.IN_FAULT
    assert drive.reset() is None
    reach(drive, lambda s: s.state is MotionState.STOPPED and is_locked(s))
    assert drive.acknowledge_stop() is None
    status = reach(drive, lambda s: s.state is not MotionState.STOPPED)
    assert status.state is MotionState.UNREFERENCED
    assert virtual.snapshot().measured_pose == ZERO_POSE


def test_the_stop_button_is_followed_until_it_is_acknowledged(drive: Drive, virtual: VirtualController) -> None:
    make_ready(drive)
    assert drive.status.stop_button is StopButton.CLEAR
    virtual.inject(Fault.EMERGENCY_STOP)
    reach(drive, lambda s: s.state is MotionState.STOPPED and s.stop_button is StopButton.PRESSED and is_locked(s))
    refusal = drive.acknowledge_stop()
    assert refusal is not None
    assert refusal.code is RefusalCode.STOP_BUTTON_PRESSED
    virtual.clear(Fault.EMERGENCY_STOP)
    reach(drive, lambda s: s.stop_button is StopButton.RELEASED and is_locked(s))
    assert drive.acknowledge_stop() is None
    status = reach(drive, lambda s: s.state is MotionState.LOCKED)
    assert status.stop_button is StopButton.CLEAR


@pytest.mark.parametrize("url", ["tcp", "pty"], indirect=True)
@pytest.mark.parametrize("fault", [Fault.DROPPED_BYTES, Fault.DUPLICATED_BYTES, Fault.WRONG_BYTES])
def test_a_bad_line_ends_in_a_known_state_and_heals(drive: Drive, virtual: VirtualController, fault: Fault) -> None:
    make_ready(drive)
    begin(drive, FAR, 3.0)
    wait_until(lambda: virtual.snapshot().moving)
    virtual.inject(fault)
    reach(drive, lambda s: s.state is not MotionState.MOVING)
    virtual.clear(fault)
    wait_until(lambda: virtual.snapshot().brake_on and not virtual.snapshot().servo_on)


def test_a_controller_that_is_not_there_yet_is_waited_for(virtual: VirtualController) -> None:
    with tcp_server(virtual) as port:
        url = f"socket://127.0.0.1:{port}"

    def connect() -> GcsController:
        return GcsController(open_port(url, 115200), HEXAPOD)

    drive = Drive(connect, SUPERVISION.read_back, time.monotonic, 0.05, lambda _: None)
    drive.start()
    status = reach(drive, lambda s: "cannot be reached" in s.detail)
    assert status.state is MotionState.DISCONNECTED
    with tcp_server(virtual, port=port):
        reach(drive, lambda s: s.state is MotionState.STOPPED)
        drive.close()
