"""Permits on the bus: what the robot takes, and every forgery that it refuses and keeps on record."""

import hashlib
from collections.abc import Callable

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from services.robot.core.permits import Permit as CorePermit
from services.robot.core.refusals import Refusal
from shared.messages.base import decode, encode
from shared.messages.cases import ObjectInside
from shared.messages.permits import SignedPermit
from shared.messages.robot import Approval, MotionState, MoveCommand, MoveCommand1, PlainCommand
from shared.pki.permit_key import PermitSigner
from tests.unit.services.robot.room import GATEWAY_KEY, SIGNER, Room, wait_for

Forgery = Callable[[Room, MoveCommand], SignedPermit]
_FOREIGN = PermitSigner(Ed25519PrivateKey.generate())
WIRE = ObjectInside(kind="wire", hole_id="distal")


def hashed(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def altered(signed: SignedPermit, old: str, new: str) -> SignedPermit:
    assert old in signed.permit_json
    return signed.model_copy(update={"permit_json": signed.permit_json.replace(old, new)})


def consistently_altered(signed: SignedPermit, old: str, new: str) -> SignedPermit:
    text = altered(signed, old, new)
    return text.model_copy(update={"permit_sha256": hashed(text.permit_json)})


def signed_nonsense() -> SignedPermit:
    """A text that the gateway's key has signed and that is no permit."""
    text = '{"schema":"distalock/permit/2"}'
    signature = GATEWAY_KEY.sign(text.encode()).hex()
    return SignedPermit(permit_json=text, permit_sha256=hashed(text), key_sha256=SIGNER.key_sha256, signature=signature)


@pytest.mark.requirement("ROB-01")
@pytest.mark.parametrize(
    ("forge", "code"),
    [
        (lambda _, c: altered(c.permit, "Dr A", "Dr B"), "permit_altered"),
        (lambda _, c: consistently_altered(c.permit, "Dr A", "Dr B"), "permit_forged"),
        (lambda room, c: room.permit(c.envelope, _FOREIGN, plan_sha256=c.plan_sha256), "permit_of_another_key"),
        (
            lambda room, c: room.permit(c.envelope, _FOREIGN, plan_sha256=c.plan_sha256).model_copy(
                update={"key_sha256": SIGNER.key_sha256}
            ),
            "permit_forged",
        ),
        (lambda _room, _command: signed_nonsense(), "permit_unreadable"),
        (
            lambda room, c: room.permit(c.envelope, motion="reference", plan_sha256=None, hole_ids=()),
            "permit_for_another_motion",
        ),
        (
            lambda room, c: room.permit(c.envelope, plan_sha256=c.plan_sha256, robot_boot_epoch="before"),
            "permit_of_another_boot",
        ),
        (
            lambda room, c: room.permit(c.envelope, plan_sha256=c.plan_sha256, hexapod_sha256="c" * 64),
            "permit_for_another_hexapod",
        ),
        (lambda room, c: room.permit(c.envelope, plan_sha256=c.plan_sha256, case_id="case0"), "permit_of_another_case"),
        (
            lambda room, c: room.permit(c.envelope, plan_sha256=c.plan_sha256, case_revision=0),
            "permit_of_another_revision",
        ),
        (lambda room, c: room.permit(c.envelope), "permit_for_another_plan"),
        (
            lambda room, c: room.permit(c.envelope, plan_sha256=c.plan_sha256, hole_ids=("proximal",)),
            "permit_for_other_holes",
        ),
        (
            lambda room, c: room.permit(c.envelope, plan_sha256=c.plan_sha256, after_state_sequence=10**9),
            "permit_state_unknown",
        ),
        (
            lambda room, c: room.permit(c.envelope, plan_sha256=c.plan_sha256, nothing_inside=False),
            "permit_without_clearance",
        ),
    ],
)
def test_a_permit_that_is_not_for_this_move_moves_nothing(room: Room, forge: Forgery, code: str) -> None:
    plan_json = room.ready_with_plan()
    command = decode(MoveCommand, room.move(plan_json))
    presented = forge(room, command)
    before = room.state.permits_refused
    reply = room.ask("move", encode(command.model_copy(update={"permit": presented})))
    assert (reply.verdict, reply.code) == ("refused", code)
    state = room.wait(lambda s: s.permits_refused == before + 1)
    assert state.permit_refusal == code
    assert room.controller.motions == []
    outcome, sha256 = room.noted[-1]
    assert isinstance(outcome, Refusal)
    assert (outcome.code, sha256) == (code, presented.permit_sha256)


def test_a_permit_that_was_taken_is_on_record(room: Room) -> None:
    plan_json = room.ready_with_plan()
    assert room.until_known(plan_json).verdict == "accepted"
    permit, sha256 = room.noted[-1]
    assert isinstance(permit, CorePermit)
    assert (permit.approver, permit.plan_sha256) == ("Dr A", hashlib.sha256(plan_json).hexdigest())
    assert room.wait(lambda s: s.state is MotionState.MOVING).permit_sha256 == sha256


@pytest.mark.requirement("ROB-01")
def test_a_permit_is_taken_once_whatever_comes_of_it(room: Room) -> None:
    plan_json = room.ready_with_plan()
    envelope = room.envelope()
    permit = room.permit(envelope, plan_sha256=hashlib.sha256(plan_json).hexdigest())
    room.begin_epoch("reg.2")
    assert room.ask("move", room.move(plan_json, envelope, permit)).code == "plan_stale"
    room.begin_epoch("reg.1")
    assert room.ask("move", room.move(plan_json, room.envelope(), permit)).code == "permit_used"
    assert room.controller.motions == []


def test_an_old_permit_in_a_new_command_is_refused(room: Room) -> None:
    plan_json = room.ready_with_plan()
    permit = room.permit(room.envelope(), plan_sha256=hashlib.sha256(plan_json).hexdigest())
    room.clock_offset_s += 2.1
    room.let_states_pass()
    reply = room.ask("move", room.move(plan_json, room.envelope(), permit))
    assert reply.code == "permit_expired"
    assert "the limit is 2 s" in reply.message
    assert room.controller.motions == []


def test_a_move_of_version_1_is_read_and_has_no_permit(room: Room) -> None:
    plan_json = room.ready_with_plan()
    approval = Approval(plan_sha256=hashlib.sha256(plan_json).hexdigest(), approved_by="Dr A", approved_at_ns=0)
    command = MoveCommand1(envelope=room.envelope(), plan_json=plan_json.decode(), approval=approval)
    assert room.ask("move", encode(command)).code == "permit_missing"
    assert room.controller.motions == []


@pytest.mark.requirement("ROB-01")
def test_a_reference_without_a_permit_moves_nothing(room: Room) -> None:
    room.wait(lambda s: s.state is MotionState.STOPPED and s.locked)
    room.acknowledge()
    room.wait(lambda s: s.state is MotionState.UNREFERENCED and s.locked)
    room.heartbeat()
    command = PlainCommand(verb="reference", envelope=room.envelope())
    assert room.ask("reference", encode(command)).code == "permit_missing"
    wrong = room.permit(command.envelope)
    permitted = command.model_copy(update={"permit": wrong, "envelope": room.envelope()})
    assert room.ask("reference", encode(permitted)).code == "permit_for_another_motion"


@pytest.mark.requirement("ROB-11")
def test_what_is_in_the_bone_forbids_every_motion_until_it_is_out(room: Room) -> None:
    plan_json = room.ready_with_plan()
    room.say_case(WIRE, ObjectInside(kind="screw", hole_id="proximal"))
    wait_for(lambda: room.reference().code == "something_inside")
    reply = room.until_known(plan_json)
    assert reply.code == "something_inside"
    assert "wire in distal, screw in proximal; take them out" in reply.message
    room.say_case()
    wait_for(lambda: room.until_known(plan_json).verdict == "accepted")


@pytest.mark.requirement("ROB-11")
def test_a_wire_that_goes_in_during_a_move_stops_it(room: Room) -> None:
    room.begin_move()
    room.say_case(WIRE)
    state = room.wait(lambda s: s.state is MotionState.STOPPED)
    assert "wire in distal" in state.detail


@pytest.mark.requirement("ROB-11")
def test_a_case_that_cannot_be_read_stops_a_move(room: Room) -> None:
    room.begin_move()
    room.cases.put(b"not a case")
    state = room.wait(lambda s: s.state is MotionState.STOPPED)
    assert "what is in the bone is not known" in state.detail


@pytest.mark.requirement("ROB-11")
def test_a_case_that_cannot_be_read_forbids_every_motion(room: Room) -> None:
    plan_json = room.ready_with_plan()
    room.cases.put(b"{}")
    wait_for(lambda: room.reference().code == "permit_of_another_case")
    assert room.until_known(plan_json).code == "permit_of_another_case"
    assert room.controller.motions == []
