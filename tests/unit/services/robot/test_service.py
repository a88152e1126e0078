"""The robot service on an in-memory bus, with a controller that has no line."""

import hashlib
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from services.robot.core.readings import READ_BACK_TOLERANCE, Deviation
from services.robot.core.situation import GuardLimits
from services.robot.drive import Drive
from services.robot.service import RobotParts, RobotService
from shared.bus.keys import Keys
from shared.bus.memory_bus import MemoryRouter
from shared.bus.port import Sample
from shared.geometry.frames import Guide
from shared.geometry.hexapod import ZERO_POSE, PlatformPose, base_from_top, leg_lengths_mm, platform_pose
from shared.geometry.transform import Transform
from shared.messages.base import decode, encode, matrix4, vector3
from shared.messages.cases import CaseContext
from shared.messages.presence import Heartbeat
from shared.messages.registration import Plan, RegistrationEpoch
from shared.messages.robot import (
    Approval,
    CommandEnvelope,
    CommandReply,
    MotionState,
    MoveCommand,
    PlainCommand,
    PlatformPoseMessage,
    RobotState,
    StopButton,
    StopCommand,
    StopLatch,
    Verb,
)
from shared.parts.hexapod_file import default_hexapod
from tests.unit.services.robot.fake_controller import FakeController

HEXAPOD = default_hexapod()
KEYS = Keys("or1")
SHA = "d" * 64
WAIT_S = 5.0


class Room:
    """A room's bus with the robot service on it, and the others' side of every conversation."""

    def __init__(self) -> None:
        self.router = MemoryRouter()
        self.controller = FakeController()
        self.clock_offset_s = 0.0
        self.bus = self.router.open()
        self.states: list[RobotState] = []
        self.sequence = 0
        self.heartbeats = 0
        self.bus.subscribe_retained(KEYS.robot_state, self._on_state)
        self.beat = self.bus.publisher(KEYS.heartbeat("ui_api"))
        self.words = 0
        self.epochs = self.bus.publisher(KEYS.registration_epoch)
        self.plans = self.bus.retained_publisher(KEYS.plan)
        self.cases = self.bus.retained_publisher(KEYS.case_context)
        self.cases.put(encode(CaseContext(case_id="case1", revision=1)))
        drive = Drive(lambda: self.controller, READ_BACK_TOLERANCE, self.clock, 0.05, lambda _: None)
        # The heartbeat's deadline is a second here: what is tested is what follows, and the machine may be busy.
        limits = GuardLimits(Deviation(20.0, 12.0), 600.0, 1.0, 5.0)
        parts = RobotParts(HEXAPOD, limits, drive, "boot", self.clock, lambda _: None)
        self.service = RobotService(self.router.open(), KEYS, parts)

    def clock(self) -> float:
        return time.monotonic() + self.clock_offset_s

    def _on_state(self, sample: Sample) -> None:
        self.states.append(decode(RobotState, sample.payload))

    @property
    def state(self) -> RobotState:
        return self.states[-1]

    def wait(self, condition: Callable[[RobotState], bool]) -> RobotState:
        """Wait until a state that fulfils the condition is published, from now on or last."""
        deadline = time.monotonic() + WAIT_S
        looked_at = max(len(self.states) - 1, 0)
        while time.monotonic() < deadline:
            for state in self.states[looked_at:]:
                if condition(state):
                    return state
            looked_at = len(self.states)
            time.sleep(0.002)
        pytest.fail(f"no such state within {WAIT_S} s; the last is {self.states[-1:]}")

    def let_states_pass(self) -> None:
        """Wait until the robot has published again: whatever was on its way has arrived, and time has passed for it."""
        before = self.state.sequence
        self.wait(lambda s: s.sequence > before + 2)

    def heartbeat(self, boot_epoch: str = "gateway1") -> None:
        self.heartbeats += 1
        self.beat.put(encode(Heartbeat(service="ui_api", boot_epoch=boot_epoch, sequence=self.heartbeats)))

    def envelope(self, command_id: str | None = None) -> CommandEnvelope:
        self.sequence += 1
        return CommandEnvelope(
            command_id=command_id or f"c{self.sequence}",
            client="gateway",
            client_sequence=self.sequence,
            robot_boot_epoch="boot",
            after_state_sequence=self.wait(lambda _: True).sequence,
            issued_at_ns=0,
        )

    def ask(self, verb: Verb, payload: bytes) -> CommandReply:
        return decode(CommandReply, self.bus.query(KEYS.robot_command(verb), payload, WAIT_S).payload)

    def acknowledge(self) -> CommandReply:
        return self.ask("acknowledge_stop", encode(PlainCommand(verb="acknowledge_stop", envelope=self.envelope())))

    def reference(self) -> CommandReply:
        return self.ask("reference", encode(PlainCommand(verb="reference", envelope=self.envelope())))

    def make_ready(self) -> None:
        self.wait(lambda s: s.state is MotionState.STOPPED and s.locked)
        assert self.acknowledge().verdict == "accepted"
        self.wait(lambda s: s.state is MotionState.UNREFERENCED and s.locked)
        self.heartbeat()
        wait_for(lambda: self.reference().verdict == "accepted")
        self.wait(lambda s: s.state is MotionState.LOCKED and s.locked and s.referenced)

    def vouch(self, epoch: str, boot_epoch: str = "reg") -> None:
        self.words += 1
        word = RegistrationEpoch(boot_epoch=boot_epoch, sequence=self.words, registration_epoch=epoch)
        self.epochs.put(encode(word))

    def begin_epoch(self, epoch: str, boot_epoch: str = "reg") -> None:
        self.vouch(epoch, boot_epoch)
        self.wait(lambda s: s.registration_epoch == epoch)

    def publish_plan(self, epoch: str = "reg.1", shift_mm: float = 3.0) -> bytes:
        content = encode(plan(epoch, shift_mm))
        self.plans.put(content)
        return content

    def move(self, plan_json: bytes, approved: str | None = None, envelope: CommandEnvelope | None = None) -> bytes:
        sha256 = approved or hashlib.sha256(plan_json).hexdigest()
        approval = Approval(plan_sha256=sha256, approved_by="surgeon", approved_at_ns=0)
        command = MoveCommand(envelope=envelope or self.envelope(), plan_json=plan_json.decode(), approval=approval)
        return encode(command)

    def ready_with_plan(self) -> bytes:
        self.make_ready()
        self.begin_epoch("reg.1")
        content = self.publish_plan()
        self.heartbeat()
        return content

    def begin_move(self) -> None:
        reply = self.until_known(self.ready_with_plan())
        assert reply.verdict == "accepted", reply
        self.wait(lambda s: s.state is MotionState.MOVING)
        wait_for(lambda: bool(self.controller.motions))

    def until_known(self, plan_json: bytes, approved: str | None = None) -> CommandReply:
        """Ask for the move; again while plan and heartbeat are still on their way to the robot."""
        deadline = time.monotonic() + WAIT_S
        while True:
            self.heartbeat()
            reply = self.ask("move", self.move(plan_json, approved))
            if reply.code not in ("plan_unknown", "heartbeat_missing") or time.monotonic() > deadline:
                return reply


def wait_for(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline, "did not come true in time"
        time.sleep(0.002)


def plan(epoch: str, shift_mm: float) -> Plan:
    correction: Transform[Guide, Guide] = Transform.from_rotvec(np.zeros(3), [shift_mm, 0.0, 0.0])
    top_from_guide = HEXAPOD.top_from_guide(60.0)
    moved = base_from_top(HEXAPOD, ZERO_POSE, HEXAPOD.pivot_mm) @ top_from_guide @ correction @ top_from_guide.inverse()
    target = platform_pose(HEXAPOD, moved, HEXAPOD.pivot_mm)
    lengths = [float(v) for v in leg_lengths_mm(HEXAPOD, target.as_array(), HEXAPOD.pivot_mm)]
    return Plan(
        case_id="case1",
        case_revision=1,
        image_sha256=SHA,
        registration_epoch=epoch,
        robot_boot_epoch="boot",
        hexapod_sha256=HEXAPOD.sha256,
        hole_ids=("distal",),
        head_extension_mm=60.0,
        guide_from_target_guide=matrix4(correction),
        start_pose=message(ZERO_POSE),
        target_pose=message(target),
        pivot_mm=vector3(HEXAPOD.pivot_mm),
        target_leg_lengths_mm=(lengths[0], lengths[1], lengths[2], lengths[3], lengths[4], lengths[5]),
        travel_mm=shift_mm,
        travel_deg=0.0,
        axial_shift_mm=0.0,
        predicted=(),
    )


def message(pose: PlatformPose) -> PlatformPoseMessage:
    x, y, z, u, v, w = (float(value) for value in pose.as_array())
    return PlatformPoseMessage(x_mm=x, y_mm=y, z_mm=z, u_deg=u, v_deg=v, w_deg=w)


@pytest.fixture
def room() -> Iterator[Room]:
    made = Room()
    with made.service:
        yield made


def test_it_starts_with_the_stop_in_force_and_publishes_steadily(room: Room) -> None:
    state = room.wait(lambda s: s.state is MotionState.STOPPED)
    assert state.stop is StopLatch.LATCHED
    assert state.hexapod_sha256 == HEXAPOD.sha256
    later = room.wait(lambda s: s.sequence > state.sequence + 3)
    assert later.boot_epoch == "boot"
    assert later.controller_identity == "fake controller"


def test_an_approved_fresh_plan_moves_once_and_ends_locked_on_the_target(room: Room) -> None:
    room.begin_move()
    room.controller.arrive()
    state = room.wait(lambda s: s.outcome == "reached" and s.state is MotionState.LOCKED and s.deviation_mm is not None)
    assert state.locked
    assert state.pose is not None
    assert state.pose.x_mm == pytest.approx(3.0)
    assert state.deviation_mm == pytest.approx(0.0)
    assert len(room.controller.motions) == 1


def test_a_repeat_gets_the_same_answer_and_moves_once(room: Room) -> None:
    plan_json = room.ready_with_plan()
    assert room.until_known(plan_json).verdict == "accepted"
    wait_for(lambda: len(room.controller.motions) == 1)
    room.controller.arrive()
    room.wait(lambda s: s.outcome == "reached" and s.deviation_mm is not None)
    envelope = room.envelope()
    again = room.move(plan_json, envelope=envelope)
    room.heartbeat()
    first, second = room.ask("move", again), room.ask("move", again)
    assert first == second
    assert first.code == "plan_already_executed"
    assert len(room.controller.motions) == 1


def test_the_same_message_twice_moves_once(room: Room) -> None:
    plan_json = room.ready_with_plan()
    assert room.until_known(plan_json).verdict == "accepted"
    accepted_id = room.wait(lambda s: s.state is MotionState.MOVING).command_id
    wait_for(lambda: len(room.controller.motions) == 1)
    room.controller.arrive()
    room.wait(lambda s: s.outcome == "reached" and s.deviation_mm is not None)
    envelope = room.envelope().model_copy(update={"command_id": accepted_id})
    reply = room.ask("move", room.move(plan_json, envelope=envelope))
    assert reply.verdict == "accepted", "the recorded answer"
    assert len(room.controller.motions) == 1


def test_a_move_without_a_plan_of_registration_is_refused(room: Room) -> None:
    room.make_ready()
    room.begin_epoch("reg.1")
    room.heartbeat()
    reply = room.ask("move", room.move(encode(plan("reg.1", 3.0))))
    assert (reply.verdict, reply.code) == ("refused", "plan_unknown")
    assert room.controller.motions == []


def test_an_approval_of_another_plan_is_refused(room: Room) -> None:
    plan_json = room.ready_with_plan()
    assert room.until_known(plan_json, approved="e" * 64).code == "approval_mismatch"


def test_a_newer_epoch_makes_the_plan_stale_before_any_localisation(room: Room) -> None:
    plan_json = room.ready_with_plan()
    room.begin_epoch("reg.2")
    assert room.until_known(plan_json).code == "plan_stale"
    assert room.controller.motions == []


def test_a_word_on_the_epoch_that_cannot_be_read_moves_nothing(room: Room) -> None:
    plan_json = room.ready_with_plan()
    room.epochs.put(b"{}")
    room.wait(lambda s: s.registration_epoch is None)
    assert room.until_known(plan_json).code == "registration_silent"
    assert room.controller.motions == []


def test_without_registration_nothing_moves(room: Room) -> None:
    token = room.bus.declare_alive(KEYS.alive("registration"))
    plan_json = room.ready_with_plan()
    token.close()
    room.wait(lambda s: s.registration_epoch is None)
    assert room.until_known(plan_json).code == "registration_silent"
    assert room.controller.motions == []
    room.begin_epoch("reg.1")
    assert room.until_known(plan_json).verdict == "accepted"


def test_registration_that_hangs_is_no_voucher(room: Room) -> None:
    plan_json = room.ready_with_plan()
    room.clock_offset_s += 5.1
    room.let_states_pass()
    reply = room.until_known(plan_json)
    assert reply.code == "registration_silent"
    assert "(limit 5 s)" in reply.message
    assert room.controller.motions == []


def test_a_word_that_comes_again_vouches_for_nothing(room: Room) -> None:
    plan_json = room.ready_with_plan()
    room.begin_epoch("reg.2")
    room.words -= 2
    room.vouch("reg.1")
    room.begin_epoch("new.0", boot_epoch="new")
    room.words += 10
    room.vouch("reg.1")
    room.let_states_pass()
    assert room.state.registration_epoch == "new.0", "neither a repeat nor an earlier run counts"
    assert room.until_known(plan_json).code == "plan_stale"


def test_a_plan_of_another_revision_of_the_case_is_refused() -> None:
    room = Room()
    room.cases.put(encode(CaseContext(case_id="case1", revision=2)))
    with room.service:
        assert room.until_known(room.ready_with_plan()).code == "plan_of_another_case"
    assert room.controller.motions == []


def test_a_plan_that_was_rewritten_is_refused(room: Room) -> None:
    plan_json = room.ready_with_plan()
    room.heartbeat()
    reply = room.ask("move", room.move(plan_json.replace(b",", b", ", 1)))
    assert reply.code == "message_invalid"
    assert "canonical form" in reply.message


def test_without_the_gateways_heartbeat_nothing_moves(room: Room) -> None:
    plan_json = room.ready_with_plan()
    assert room.until_known(plan_json, approved="e" * 64).code == "approval_mismatch"

    def unheard() -> bool:
        """Two seconds later, once the heartbeats that were still on their way have arrived."""
        room.clock_offset_s += 2.0
        room.let_states_pass()
        return room.ask("move", room.move(plan_json, approved="e" * 64)).code == "heartbeat_missing"

    wait_for(unheard)
    assert room.ask("move", room.move(plan_json)).code == "heartbeat_missing"
    assert room.controller.motions == []


def test_without_the_gateways_heartbeat_nothing_is_referenced(room: Room) -> None:
    room.wait(lambda s: s.state is MotionState.STOPPED and s.locked)
    room.acknowledge()
    room.wait(lambda s: s.state is MotionState.UNREFERENCED and s.locked)
    assert room.reference().code == "heartbeat_missing"


def test_a_late_command_is_refused_and_nothing_moves(room: Room) -> None:
    plan_json = room.ready_with_plan()
    command = room.move(plan_json)
    room.clock_offset_s += 1.5
    room.heartbeat()
    reply = room.ask("move", command)
    assert reply.code == "command_expired"
    assert room.controller.motions == []


def test_a_command_to_another_boot_is_refused(room: Room) -> None:
    room.wait(lambda s: s.state is MotionState.STOPPED)
    envelope = room.envelope().model_copy(update={"robot_boot_epoch": "before"})
    reply = room.ask("acknowledge_stop", encode(PlainCommand(verb="acknowledge_stop", envelope=envelope)))
    assert reply.code == "wrong_boot_epoch"


def test_a_command_on_the_key_of_another_is_refused(room: Room) -> None:
    reply = room.ask("reset", encode(PlainCommand(verb="acknowledge_stop", envelope=room.envelope())))
    assert reply.code == "message_invalid"


@pytest.mark.parametrize("verb", ["move", "reference", "acknowledge_stop", "reset"])
def test_what_cannot_be_read_is_refused_with_a_sentence(room: Room, verb: Verb) -> None:
    reply = room.ask(verb, b"{")
    assert (reply.verdict, reply.code) == ("refused", "message_invalid")
    assert reply.message.startswith("the command was not understood: not a valid")


def test_a_stop_during_a_move_locks_within_a_fifth_of_a_second(room: Room) -> None:
    room.begin_move()
    asked_s = time.monotonic()
    reply = room.ask("stop", encode(StopCommand(client="console", reason="pressed")))
    locked_s = time.monotonic() - asked_s
    assert room.controller.reading.locked
    assert locked_s < 0.2
    assert (reply.verdict, reply.state) == ("accepted", MotionState.STOPPED)
    state = room.wait(lambda s: s.state is MotionState.STOPPED and s.locked and s.pose is not None)
    assert state.outcome == "stopped"
    assert state.detail == "'console' asked for a stop: pressed"


def test_a_stop_that_cannot_be_read_stops_all_the_same(room: Room) -> None:
    room.begin_move()
    assert room.ask("stop", b"\xff\x00").verdict == "accepted"
    assert room.controller.reading.locked


def test_a_stop_waits_for_no_other_command(room: Room) -> None:
    room.begin_move()
    # As if another command were being decided on and never ended.
    with room.service._lock:
        reply = room.ask("stop", encode(StopCommand(client="console")))
    assert reply.verdict == "accepted"
    assert room.controller.reading.locked


def test_a_gateway_that_falls_silent_stops_the_move(room: Room) -> None:
    room.begin_move()
    room.clock_offset_s += 1.1
    state = room.wait(lambda s: s.state is MotionState.STOPPED)
    assert "the gateway was silent for" in state.detail
    assert room.controller.reading.locked


def test_a_gateway_that_restarts_stops_the_move(room: Room) -> None:
    room.begin_move()
    room.heartbeat("gateway2")
    assert "restarted" in room.wait(lambda s: s.state is MotionState.STOPPED).detail


def test_a_gateway_whose_token_vanishes_stops_the_move(room: Room) -> None:
    token = room.bus.declare_alive(KEYS.alive("ui_api"))
    room.begin_move()
    token.close()
    assert "token vanished" in room.wait(lambda s: s.state is MotionState.STOPPED).detail


def test_repeated_heartbeats_are_no_sign_of_life(room: Room) -> None:
    room.begin_move()
    for _ in range(100):
        room.heartbeats -= 1
        room.heartbeat()
        time.sleep(0.01)  # as a bus would repeat one, while the robot's clock runs six times as fast
        room.clock_offset_s += 0.05
        if room.state.state is MotionState.STOPPED:
            break
    else:
        pytest.fail("the same heartbeat over and over kept the robot moving for six seconds")
    assert "silent" in room.state.detail


def test_a_lost_router_stops_the_move(room: Room) -> None:
    room.begin_move()
    room.router.cut()
    wait_for(lambda: room.controller.stopped)
    assert room.controller.reading.locked
    room.router.restore()
    state = room.wait(lambda s: s.state is MotionState.STOPPED)
    assert "link to the router was lost" in state.detail or "token vanished" in state.detail


def test_a_silent_controller_is_a_fault_that_a_person_resets(room: Room) -> None:
    room.make_ready()
    room.controller.failures = ["the hexapod controller is silent"]
    state = room.wait(lambda s: s.state is MotionState.FAULT)
    assert "silent" in state.detail
    reply = room.ask("reset", encode(PlainCommand(verb="reset", envelope=room.envelope())))
    assert reply.verdict == "accepted"
    room.wait(lambda s: s.state is MotionState.STOPPED)


def test_a_plan_from_before_a_reconnection_is_refused(room: Room) -> None:
    plan_json = room.ready_with_plan()
    room.begin_epoch("reg.2")
    assert room.until_known(plan_json).code == "plan_stale", "the robot has heard of it, and did not begin it"
    room.controller.failures = ["the hexapod controller is silent"]
    room.wait(lambda s: s.state is MotionState.FAULT)
    room.ask("reset", encode(PlainCommand(verb="reset", envelope=room.envelope())))
    room.wait(lambda s: s.state is MotionState.STOPPED and s.locked)
    room.acknowledge()
    room.wait(lambda s: s.state is MotionState.LOCKED and s.locked)
    room.begin_epoch("reg.1")
    assert room.until_known(plan_json).code == "plan_before_reconnection"
    assert room.until_known(room.publish_plan(shift_mm=2.0)).verdict == "accepted"


def test_leaving_during_a_move_locks() -> None:
    room = Room()
    with room.service:
        room.begin_move()
    assert room.controller.reading.locked
    assert room.controller.closed
    assert room.wait(lambda s: s.state is MotionState.DISCONNECTED).stop is StopLatch.LATCHED


def test_it_does_not_move_what_it_found_elsewhere(room: Room) -> None:
    plan_json = room.ready_with_plan()
    room.ask("stop", encode(StopCommand(client="gateway")))
    room.wait(lambda s: s.state is MotionState.STOPPED and s.locked)
    elsewhere = PlatformPose(0.1, 0.0, 0.0, 0.0, 0.0, 0.0)
    room.controller.reading = replace(room.controller.reading, pose=elsewhere)
    room.wait(lambda s: s.pose is not None and s.pose.x_mm == 0.1)
    assert room.acknowledge().verdict == "accepted"
    room.wait(lambda s: s.state is MotionState.LOCKED and s.locked)
    assert room.until_known(plan_json).code == "start_pose_differs"


def test_a_locked_robot_that_shifts_is_a_fault(room: Room) -> None:
    room.ready_with_plan()
    room.controller.reading = replace(room.controller.reading, pose=PlatformPose(0.0, 0.0, -0.3, 0.0, 0.0, 0.0))
    state = room.wait(lambda s: s.state is MotionState.FAULT)
    assert "the locked robot has moved by 0.300 mm" in state.detail


def test_a_stop_button_goes_through_its_states(room: Room) -> None:
    room.make_ready()
    room.wait(lambda s: s.stop_button is StopButton.CLEAR)
    room.controller.button_code = 500
    state = room.wait(lambda s: s.state is MotionState.STOPPED and s.locked)
    assert (state.stop_button, state.stop) == (StopButton.PRESSED, StopLatch.LATCHED)
    assert room.acknowledge().code == "stop_button_pressed"
    room.controller.button_code = 0
    room.wait(lambda s: s.stop_button is StopButton.RELEASED and s.locked)
    assert room.acknowledge().verdict == "accepted"
    room.wait(lambda s: s.stop_button is StopButton.CLEAR and s.state is MotionState.LOCKED)
