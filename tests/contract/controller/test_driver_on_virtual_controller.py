"""Our driver against the virtual controller, over TCP, a pseudo-terminal and RFC 2217: what both must agree on."""

import time

import pytest

from services.robot.core.deviation import Deviation, deviation
from services.robot.core.tuning import SUPERVISION
from services.robot.devices.controller import ControllerSilent, Encoders
from services.robot.devices.gcs.controller import GcsController
from services.robot.devices.serial_port import open_port
from shared.errors import DeviceError
from shared.geometry.hexapod import PlatformPose
from simulation.controller import hexapod_model
from simulation.controller.faults import Fault
from simulation.controller.servers import tcp_server
from simulation.controller.virtual_controller import VirtualController
from tests.contract.controller.lines import FAR, HEXAPOD, NEAR, wait_until

# pyserial's RFC 2217 names its thread in a way that Python 3.10 deprecated.
pytestmark = pytest.mark.filterwarnings("ignore:set(Daemon|Name)\\(\\) is deprecated:DeprecationWarning")


def test_connecting_finds_a_locked_controller_that_says_what_it_is(
    controller: GcsController, virtual: VirtualController
) -> None:
    assert "simulated" in controller.identity
    feedback = controller.read()
    assert (feedback.locked, feedback.moving, feedback.referenced, feedback.error) == (True, False, False, None)
    assert virtual.snapshot().brake_on


@pytest.mark.requirement("ROB-14")
def test_reference_with_absolute_encoders_moves_nothing(referenced: GcsController, virtual: VirtualController) -> None:
    assert virtual.snapshot().measured_pose == HEXAPOD.home_pose
    assert referenced.read().locked


def test_reference_with_incremental_encoders_unlocks_and_moves_home() -> None:
    virtual = VirtualController(HEXAPOD, time.monotonic, encoders=hexapod_model.Encoders.INCREMENTAL)
    with tcp_server(virtual) as port:
        controller = GcsController(open_port(f"socket://127.0.0.1:{port}", 115200), HEXAPOD, Encoders.INCREMENTAL)
        controller.release_stop()
        controller.reference()
        wait_until(lambda: controller.read().referenced)
        controller.lock()
        assert controller.read().locked
        controller.close()


def test_a_move_arrives_and_locks(referenced: GcsController, virtual: VirtualController) -> None:
    referenced.move(NEAR, 2.0)
    wait_until(lambda: referenced.read().on_target)
    referenced.lock()
    feedback = referenced.read()
    assert not deviation(NEAR, feedback.pose).exceeds(SUPERVISION.read_back)
    assert feedback.locked
    assert not virtual.snapshot().was_unheld


def test_a_stop_in_a_move_is_at_once_and_the_position_is_known(
    referenced: GcsController, virtual: VirtualController
) -> None:
    referenced.move(FAR, 2.0)
    assert referenced.read().moving
    asked_s = time.monotonic()
    referenced.stop_now()
    wait_until(lambda: virtual.snapshot().brake_on and not virtual.snapshot().servo_on)
    assert time.monotonic() - asked_s < 0.2
    feedback = referenced.read()
    assert feedback.locked
    assert not deviation(virtual.snapshot().measured_pose, feedback.pose).exceeds(Deviation(0.001, 0.001))
    assert feedback.pose.x_mm < FAR.x_mm - 1.0


def test_after_a_stop_the_next_move_begins_where_it_stands(
    referenced: GcsController, virtual: VirtualController
) -> None:
    referenced.move(FAR, 2.0)
    referenced.stop_now()
    referenced.lock()
    stood = virtual.snapshot().measured_pose
    referenced.release_stop()
    referenced.move(stood, 2.0)
    wait_until(lambda: referenced.read().on_target)
    assert not deviation(stood, virtual.snapshot().measured_pose).exceeds(Deviation(0.002, 0.002))


def test_a_target_out_of_reach_is_refused_while_locked(referenced: GcsController, virtual: VirtualController) -> None:
    with pytest.raises(DeviceError, match="cannot reach the target"):
        referenced.move(PlatformPose(0.0, 0.0, 12.0, 0.0, 0.0, 0.0), 2.0)
    assert virtual.snapshot().brake_on


def test_a_speed_beyond_the_limit_is_refused(referenced: GcsController) -> None:
    with pytest.raises(DeviceError, match="velocity is outside the controller's limits"):
        referenced.move(NEAR, 5.0)


def test_silence_and_garbage_become_sentences(referenced: GcsController, virtual: VirtualController) -> None:
    virtual.inject(Fault.GARBAGE_REPLY)
    with pytest.raises(DeviceError, match="check the cable"):
        referenced.read()
    virtual.clear(Fault.GARBAGE_REPLY)
    virtual.inject(Fault.SILENCE)
    with pytest.raises(ControllerSilent, match="silent"):
        referenced.read()
    virtual.clear(Fault.SILENCE)
    assert referenced.read().locked


@pytest.mark.requirement("ROB-17")
def test_connecting_to_a_moving_robot_stops_and_locks_it(referenced: GcsController, virtual: VirtualController) -> None:
    referenced.move(FAR, 2.0)
    referenced.close()
    with tcp_server(virtual) as port:
        again = GcsController(open_port(f"socket://127.0.0.1:{port}", 115200), HEXAPOD)
        feedback = again.read()
        again.close()
    assert (feedback.locked, feedback.moving) == (True, False)
    assert not virtual.snapshot().moving
