"""The GCS driver against a small controller at the other end of the port: commands, locking, stops."""

import threading

import pytest

from services.robot.core.controller_feedback import ErrorKind
from services.robot.devices.controller import ControllerSilent, Encoders, StopInForce
from services.robot.devices.gcs.controller import LOCK_UNCONFIRMED, GcsController
from shared.errors import DeviceError
from shared.geometry.hexapod import PlatformPose
from shared.parts.hexapod_file import default_hexapod
from tests.unit.services.robot.fake_gcs import FakeGcs

HEXAPOD = default_hexapod()
TARGET = PlatformPose(1.0, -2.0, 0.5, 1.0, -1.0, 0.25)
SHORT_S = 0.05


def test_connecting_stops_and_locks_before_anything_is_asked(gcs: FakeGcs) -> None:
    gcs.servo, gcs.brake, gcs.moving = dict.fromkeys(gcs.servo, 1), dict.fromkeys(gcs.brake, 0), True
    GcsController(gcs, HEXAPOD).close()
    assert gcs.messages[0] == b"\x18"
    assert gcs.messages[1].startswith(b"BRA X 1")
    commands = [m.split()[0] for m in gcs.messages[1:] if not m.split()[0].endswith(b"?")]
    assert commands[:7] == [b"BRA"] * 6 + [b"SVO"]
    assert gcs.locked
    assert not gcs.moving


def test_connecting_sets_the_pivot_of_the_hexapod_file_and_reports_the_identity(
    gcs: FakeGcs, controller: GcsController
) -> None:
    assert gcs.pivot == {"R": 60.0, "S": 0.0, "T": 20.0}
    assert controller.identity == gcs.identity


def test_feedback_is_complete(gcs: FakeGcs, controller: GcsController) -> None:
    gcs.position = dict(zip("XYZUVW", (1.0, 2.0, 3.0, 4.0, 5.0, 6.0), strict=True))
    feedback = controller.read()
    assert feedback.pose == PlatformPose(1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    assert (feedback.locked, feedback.unlocked, feedback.moving, feedback.referenced) == (True, False, False, True)
    assert not feedback.on_target


def test_a_move_unlocks_servo_first_and_reads_its_target_back(gcs: FakeGcs, released: GcsController) -> None:
    gcs.messages.clear()
    released.move(TARGET, 1.5)
    commands = [m.split()[0] for m in gcs.messages if not m.split()[0].endswith(b"?")]
    assert commands == [b"VLS", b"SVO", b"BRA", b"MOV"]
    assert [m for m in gcs.messages if m.startswith(b"MOV?")][-1]
    assert gcs.target == pytest.approx(dict(zip("XYZUVW", TARGET.as_array(), strict=True)))
    assert gcs.speed == 1.5


def test_locking_brakes_first(gcs: FakeGcs, released: GcsController) -> None:
    released.move(TARGET, 1.0)
    gcs.arrive()
    gcs.messages.clear()
    released.lock()
    commands = [m.split()[0] for m in gcs.messages if not m.split()[0].endswith(b"?")]
    assert commands == [b"BRA", b"SVO"]
    assert gcs.locked


def test_nothing_moves_before_the_stop_is_released(gcs: FakeGcs, controller: GcsController) -> None:
    with pytest.raises(StopInForce, match="a stop is in force: the motion command was not sent"):
        controller.move(TARGET, 1.0)
    with pytest.raises(StopInForce):
        controller.reference()
    assert gcs.locked
    assert not any(m.startswith((b"MOV X", b"FRF X")) for m in gcs.messages)


def test_the_stop_byte_is_the_first_write_and_goes_before_the_lock(gcs: FakeGcs, released: GcsController) -> None:
    released.move(TARGET, 1.0)
    gcs.writes.clear()
    released.stop_now()
    assert gcs.writes == [b"\x18", LOCK_UNCONFIRMED]


def test_stops_that_come_together_send_the_lock_once(gcs: FakeGcs, released: GcsController) -> None:
    released.move(TARGET, 1.0)
    gcs.writes.clear()
    for _ in range(20):
        released.stop_now()
    assert gcs.writes == [b"\x18", LOCK_UNCONFIRMED, *(19 * [b"\x18"])]


def test_a_stop_after_a_command_that_could_unlock_sends_the_lock_again(gcs: FakeGcs, released: GcsController) -> None:
    for _ in range(2):
        released.release_stop()
        released.move(TARGET, 1.0)
        gcs.writes.clear()
        released.stop_now()
        assert gcs.writes == [b"\x18", LOCK_UNCONFIRMED]
        gcs.error = 0  # that it was stopped


def test_a_lock_that_the_line_did_not_take_is_sent_again(gcs: FakeGcs, released: GcsController) -> None:
    released.move(TARGET, 1.0)
    gcs.broken = OSError("no space in the buffer")
    assert released.stop_now() is not None
    gcs.broken = None
    gcs.writes.clear()
    assert released.stop_now() is None
    assert gcs.writes == [b"\x18", LOCK_UNCONFIRMED]


def test_a_stop_locks_without_an_answer(gcs: FakeGcs, released: GcsController) -> None:
    released.move(TARGET, 1.0)
    gcs.mute = True
    heard = iter(range(100))
    gcs.disturb = lambda m: b"BRR X 1" if m.startswith(b"BRA X 1") and next(heard) < 5 else m
    released.stop_now()
    assert gcs.locked
    assert not gcs.moving


def test_when_locking_the_servos_stay_on_until_the_brakes_are(gcs: FakeGcs, released: GcsController) -> None:
    released.move(TARGET, 1.0)
    gcs.disturb = lambda message: b"BRR X 1" if message.startswith(b"BRA X 1") else message
    with pytest.raises(DeviceError, match=r"brakes are off on .* only the servos hold it"):
        released.lock()
    assert all(gcs.servo.values())
    gcs.disturb = lambda message: message
    gcs.error = 0
    released.lock()
    assert gcs.locked


def test_a_mute_controller_is_locked_by_repetition(gcs: FakeGcs, released: GcsController) -> None:
    released.move(TARGET, 1.0)
    gcs.mute = True
    heard = iter(range(100))
    gcs.disturb = lambda m: b"BRR X 1" if m.startswith(b"BRA X 1") and next(heard) < 4 else m
    with pytest.raises(ControllerSilent):
        released.lock()
    assert gcs.locked


def test_brakes_stay_on_when_the_servos_do_not_come_on(gcs: FakeGcs, released: GcsController) -> None:
    gcs.disturb = lambda message: b"" if message.startswith(b"SVO X 1") else message
    with pytest.raises(DeviceError, match="the servos do not switch on, so the brakes stay on"):
        released.move(TARGET, 1.0)
    assert all(gcs.brake.values())


def test_a_stop_does_not_wait_for_a_question_that_nobody_answers(gcs: FakeGcs, released: GcsController) -> None:
    released.move(TARGET, 1.0)
    gcs.mute = True

    def ask() -> None:
        with pytest.raises(ControllerSilent):
            released.read()

    asking = threading.Thread(target=ask)
    asking.start()
    released.stop_now()
    assert asking.is_alive(), "the question ended before the stop: the test shows nothing"
    assert gcs.locked
    asking.join()


def test_a_stop_before_the_motion_command_keeps_it_from_going_out(gcs: FakeGcs, released: GcsController) -> None:
    def stop_when_unlocking(question: bytes, answer: bytes) -> bytes:
        if question == b"VMO?":
            released_stop.start()
            released_stop.join(0.0)
        return answer

    released_stop = threading.Thread(target=released.stop_now)
    gcs.spoil = stop_when_unlocking
    with pytest.raises(StopInForce):
        released.move(TARGET, 1.0)
    released_stop.join()
    assert gcs.locked
    assert not gcs.moving


def test_an_old_target_that_would_be_run_to_on_unlocking_is_refused(gcs: FakeGcs, released: GcsController) -> None:
    gcs.target["X"] = 3.0
    with pytest.raises(DeviceError, match=r"holds a target 3\.000 mm and 0\.000° from where the robot stands"):
        released.move(TARGET, 1.0)
    assert gcs.locked


def test_a_target_that_was_taken_wrongly_is_stopped(gcs: FakeGcs, released: GcsController) -> None:
    gcs.disturb = lambda m: m.replace(b"X 1.000000", b"X 9.000000") if m.startswith(b"MOV ") else m
    with pytest.raises(DeviceError, match=r"8\.000000 apart; it was stopped, check the cable"):
        released.move(TARGET, 1.0)
    assert gcs.locked
    assert not gcs.moving


def test_a_target_the_controller_cannot_reach_is_refused_before_unlocking(
    gcs: FakeGcs, released: GcsController
) -> None:
    gcs.reachable = False
    with pytest.raises(DeviceError, match="cannot reach the target"):
        released.move(TARGET, 1.0)
    assert gcs.locked


def test_errors_become_sentences_and_lock(gcs: FakeGcs, released: GcsController) -> None:
    gcs.referenced["X"] = 0
    with pytest.raises(DeviceError, match="could not move: an axis is not referenced or its servo is off"):
        released.move(TARGET, 1.0)
    assert gcs.locked


def test_a_speed_that_was_not_taken_is_refused(gcs: FakeGcs, released: GcsController) -> None:
    gcs.disturb = lambda m: b"VLS 1.9" if m.startswith(b"VLS ") else m
    with pytest.raises(DeviceError, match=r"speed is 1\.9 mm/s after setting it to 1 mm/s"):
        released.move(TARGET, 1.0)


def test_a_brake_that_does_not_go_on_is_reported(gcs: FakeGcs, released: GcsController) -> None:
    released.move(TARGET, 1.0)
    gcs.brakes_hold = False
    with pytest.raises(DeviceError, match=r"does not lock: brakes are off on \['X', 'Y', 'Z', 'U', 'V', 'W'\]"):
        released.lock()


def test_reference_with_absolute_encoders_stays_locked(gcs: FakeGcs, released: GcsController) -> None:
    gcs.referenced = dict.fromkeys(gcs.referenced, 0)
    gcs.messages.clear()
    released.reference()
    assert released.read().referenced
    assert not any(m.startswith(b"SVO X") for m in gcs.messages)


def test_reference_with_incremental_encoders_unlocks(gcs: FakeGcs) -> None:
    controller = GcsController(gcs, HEXAPOD, Encoders.INCREMENTAL)
    controller.release_stop()
    controller.reference()
    assert controller.read().unlocked
    controller.close()


def test_a_fault_does_not_hide_the_button_that_was_reported_before(gcs: FakeGcs, released: GcsController) -> None:
    gcs.pressed = True
    with pytest.raises(StopInForce):
        released.move(TARGET, 1.0)
    gcs.error = -1024
    kinds = [error.kind for error in (released.read().error, released.read().error) if error is not None]
    assert kinds == [ErrorKind.FAULT, ErrorKind.STOP_BUTTON_PRESSED]
    assert released.read().error is None


def test_the_controllers_own_stop_button_holds_a_move_back(gcs: FakeGcs, released: GcsController) -> None:
    gcs.pressed = True
    with pytest.raises(StopInForce, match="the controller's stop button is pressed"):
        released.move(TARGET, 1.0)
    assert gcs.locked
