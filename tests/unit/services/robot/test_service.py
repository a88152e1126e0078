"""The robot service on an in-memory bus: what moves, once, and what is refused."""

import pytest

from shared.messages.base import encode
from shared.messages.robot import (
    MotionState,
    PlainCommand,
    StopLatch,
    Verb,
)
from tests.unit.services.robot.room import HEXAPOD, KEYS, Room, plan, wait_for


@pytest.mark.requirement("ROB-17")
def test_it_starts_with_the_stop_in_force_and_publishes_steadily(room: Room) -> None:
    state = room.wait(lambda s: s.state is MotionState.STOPPED)
    assert state.stop is StopLatch.LATCHED
    assert state.hexapod_sha256 == HEXAPOD.sha256
    later = room.wait(lambda s: s.sequence > state.sequence + 3)
    assert later.boot_epoch == "boot"
    assert later.controller_identity == "fake controller"


@pytest.mark.requirement("ROB-13")
def test_an_approved_fresh_plan_moves_once_and_ends_locked_on_the_target(room: Room) -> None:
    room.begin_move()
    room.controller.arrive()
    state = room.wait(lambda s: s.outcome == "reached" and s.state is MotionState.LOCKED and s.deviation_mm is not None)
    assert state.locked
    assert state.pose is not None
    assert state.pose.x_mm == pytest.approx(3.0)
    assert state.deviation_mm == pytest.approx(0.0)
    assert len(room.controller.motions) == 1


@pytest.mark.requirement("ROB-10")
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


@pytest.mark.requirement("ROB-18")
def test_a_move_without_a_plan_of_registration_is_refused(room: Room) -> None:
    room.make_ready()
    room.begin_epoch("reg.1")
    room.heartbeat()
    reply = room.ask("move", room.move(encode(plan("reg.1", 3.0))))
    assert (reply.verdict, reply.code) == ("refused", "plan_unknown")
    assert room.controller.motions == []


@pytest.mark.requirement("REG-08")
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


@pytest.mark.requirement("ROB-18")
def test_a_plan_of_another_revision_of_the_case_is_refused() -> None:
    room = Room()
    room.case_revision = 2
    room.say_case()
    with room.service:
        assert room.until_known(room.ready_with_plan()).code == "plan_of_another_case"
    assert room.controller.motions == []


def test_without_the_gateways_heartbeat_nothing_moves(room: Room) -> None:
    plan_json = room.ready_with_plan()
    unpublished = encode(plan("reg.1", 2.0))

    def unheard() -> bool:
        """Two seconds later, once the heartbeats that were still on their way have arrived."""
        room.clock_offset_s += 2.0
        room.let_states_pass()
        return room.ask("move", room.move(unpublished)).code == "heartbeat_missing"

    wait_for(unheard)
    assert room.ask("move", room.move(plan_json)).code == "heartbeat_missing"
    assert room.controller.motions == []


def test_without_the_gateways_heartbeat_nothing_is_referenced(room: Room) -> None:
    room.wait(lambda s: s.state is MotionState.STOPPED and s.locked)
    room.acknowledge()
    room.wait(lambda s: s.state is MotionState.UNREFERENCED and s.locked)
    assert room.reference().code == "heartbeat_missing"


@pytest.mark.requirement("ROB-10")
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
