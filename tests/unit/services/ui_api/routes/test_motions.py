"""Motions: only from an approved, current plan; at most once; followed to their end."""

import threading

import pytest

from services.ui_api.core.events import EventKind
from services.ui_api.core.robot_event_data import RobotChanged
from shared.messages.base import decode
from shared.messages.cases import CaseContext
from shared.messages.permits import Permit
from shared.messages.robot import CommandReply, MotionState, MoveCommand, StopLatch
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.room import Room, wait_until


def _move(room: Room, case_id: str, plan: int, **more: object) -> str:
    answer = room.post(f"/cases/{case_id}/motions", {"plan": plan, **more})
    assert answer.status_code == 202, answer.text
    return str(answer.json()["id"])


def _assert_refused(room: Room, case_id: str, plan: int, code: str) -> str:
    answer = room.post(f"/cases/{case_id}/motions", {"plan": plan})
    assert (answer.status_code, answer.json()["code"]) == (409, code), answer.text
    assert room.robot.moves == []
    return str(answer.json()["detail"])


def test_the_command_quotes_plan_approval_and_newest_state(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    newest = room.robot.say(MotionState.LOCKED, controller_identity="another")
    room.log.wait_for_event(lambda e: getattr(e.data, "controller_identity", "") == "another")
    operation_id = _move(room, case_id, plan)
    room.wait_for_status(operation_id, "running")
    command = room.robot.moves[0]
    assert command.envelope.command_id == operation_id
    assert command.envelope.robot_boot_epoch == samples.ROBOT_EPOCH
    assert command.envelope.after_state_sequence == newest.sequence
    permit = decode(Permit, command.permit.permit_json.encode())
    assert (permit.approver, permit.motion, permit.nothing_inside) == ("demo", "move", True)
    assert permit.authenticated_by == "simulation_token"
    assert (
        permit.plan_sha256 == command.plan_sha256 == room.gateway.record.ledger.cases[case_id].plans[0].made.plan_sha256
    )
    assert (permit.case_id, permit.case_revision, set(permit.hole_ids)) == (case_id, 1, {"proximal", "distal"})
    assert (permit.robot_boot_epoch, permit.after_state_sequence) == (samples.ROBOT_EPOCH, newest.sequence)


@pytest.mark.requirement("GW-01")
def test_motion_without_approval_moves_nothing(room: Room) -> None:
    room.image("image", case_id := room.open_case())
    room.post(f"/cases/{case_id}/plans", {"localisation": 1, "hole_ids": ["distal"]})
    assert "a surgeon checks it and approves it" in _assert_refused(room, case_id, 1, "plan_not_approved")


@pytest.mark.requirement("GW-02")
def test_motion_from_a_plan_older_than_the_newest_image_moves_nothing(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    room.image("newer", case_id)
    assert "a newer image has arrived" in _assert_refused(room, case_id, plan, "plan_stale")


@pytest.mark.requirement("GW-02")
def test_motion_after_the_set_up_changed_moves_nothing(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    changed = room.patch(f"/cases/{case_id}", {"head_extension_mm": 70.0})
    assert changed.json()["revision"] == 2
    assert "revision 1" in _assert_refused(room, case_id, plan, "plan_stale")


@pytest.mark.requirement("GW-02")
def test_motion_after_the_robot_restarted_moves_nothing(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    room.robot.say(MotionState.LOCKED, boot_epoch="robot-2")
    room.log.wait_for_event(lambda e: getattr(e.data, "boot_epoch", "") == "robot-2")
    assert "robot service restarted" in _assert_refused(room, case_id, plan, "plan_stale")


@pytest.mark.requirement("GW-13")
def test_motion_with_wires_in_place_moves_nothing(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    room.post(f"/cases/{case_id}/steps", {"step": "wires_inserted", "why": "checking by hand"})
    assert "wires are in distal, proximal" in _assert_refused(room, case_id, plan, "wires_in_place")


@pytest.mark.requirement("GW-13")
@pytest.mark.parametrize(
    ("inserted", "removed", "code"),
    [
        ("wires_inserted", "wires_removed", "wires_in_place"),
        ("drill_inserted", "drilled", "drill_in_place"),
        ("screws_inserted", "screws_removed", "screws_in_place"),
    ],
)
def test_whatever_is_in_the_bone_forbids_move_and_reference_until_it_is_out(
    room: Room, inserted: str, removed: str, code: str
) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    contexts: list[CaseContext] = []
    room.robot.bus.subscribe_retained(
        room.robot.keys.case_context, lambda sample: contexts.append(decode(CaseContext, sample.payload))
    )
    wait_until(lambda: bool(contexts))
    room.post(f"/cases/{case_id}/steps", {"step": inserted, "hole_ids": ["distal"], "why": "by hand"})
    wait_until(lambda: [found.hole_id for found in contexts[-1].inside] == ["distal"])
    detail = _assert_refused(room, case_id, plan, code)
    assert "are in distal: the robot does not move before they are removed; take them out and record" in detail
    answer = room.post("/robot/reference")
    assert (answer.status_code, answer.json()["code"]) == (409, code)
    assert room.robot.plain == []
    assert room.client.post("/api/v1/robot/stop").status_code == 200
    room.post(f"/cases/{case_id}/steps", {"step": removed, "hole_ids": ["distal"], "why": "by hand"})
    wait_until(lambda: contexts[-1].inside == ())
    room.unreference()
    assert room.post("/robot/reference").status_code == 202


def test_nothing_is_reported_as_put_in_while_a_reference_is_pending(room: Room) -> None:
    case_id = room.open_case()
    room.unreference()
    operation_id = room.post("/robot/reference").json()["id"]
    wires = {"step": "wires_inserted", "hole_ids": ["distal"], "why": "by hand"}
    answer = room.post(f"/cases/{case_id}/steps", wires)
    assert (answer.status_code, answer.json()["code"]) == (409, "robot_moving")
    assert operation_id in answer.json()["detail"]


def test_a_reference_carries_a_permit_that_the_record_keeps(room: Room) -> None:
    room.unreference()
    operation_id = room.post("/robot/reference").json()["id"]
    wait_until(lambda: bool(room.robot.plain))
    signed = room.robot.plain[0].permit
    assert signed is not None
    permit = decode(Permit, signed.permit_json.encode())
    assert (permit.motion, permit.approver, permit.plan_sha256, permit.case_id) == ("reference", "demo", None, None)
    assert room.gateway.record.document(signed.permit_sha256).decode() == signed.permit_json
    requested = room.gateway.record.ledger.operations[operation_id].requested
    assert (requested.permit_signature, requested.permit_key_sha256) == (signed.signature, signed.key_sha256)
    view = room.get(f"/operations/{operation_id}").json()
    assert (view["approver"], view["permit_sha256"]) == ("demo", signed.permit_sha256)


def test_the_record_has_the_robots_word_of_the_permit_that_it_moves_by_and_of_no_earlier_one(room: Room) -> None:
    room.open_case()
    sha256 = samples.sha("permit")

    def named() -> list[str | None]:
        events = room.gateway.record.events_after(0)
        return [event.data.permit_sha256 for event in events if isinstance(event.data, RobotChanged)]

    room.robot.say(MotionState.MOVING, permit_sha256=sha256)
    room.robot.say(MotionState.LOCKED, permit_sha256=sha256)
    wait_until(lambda: named()[-2:] == [sha256, None])


def test_a_permit_that_the_robot_refuses_is_on_record(room: Room) -> None:
    room.robot.say(MotionState.LOCKED, permits_refused=1, permit_refusal="permit_forged")
    room.log.wait_for_event(lambda e: getattr(e.data, "permit_refusal", "") == "permit_forged")
    room.robot.say(MotionState.LOCKED, permits_refused=2, permit_refusal="permit_forged")
    room.log.wait_for_event(lambda e: getattr(e.data, "permits_refused", 0) == 2)


def test_motion_while_a_stop_is_latched_moves_nothing(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    room.robot.say(MotionState.STOPPED, stop=StopLatch.LATCHED)
    room.log.wait_for_event(lambda e: getattr(e.data, "stop", "") == "latched")
    assert "acknowledge it first" in _assert_refused(room, case_id, plan, "stop_in_force")


def test_motion_from_an_unreferenced_robot_moves_nothing(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    room.robot.say(MotionState.UNREFERENCED)
    room.log.wait_for_event(lambda e: getattr(e.data, "state", "") == "unreferenced")
    assert "without a reference" in _assert_refused(room, case_id, plan, "plan_stale")


def test_a_controller_that_was_slow_to_answer_makes_no_plan_stale(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    room.robot.say(MotionState.LOCKED, locked=False, referenced=False, pose=None)
    room.log.wait_for_event(lambda e: getattr(e.data, "referenced", True) is False)
    room.robot.say(MotionState.LOCKED)
    room.wait_for_status(_move(room, case_id, plan), "running")
    assert len(room.robot.moves) == 1


def test_a_plan_moves_once(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    operation_id = _move(room, case_id, plan)
    room.wait_for_status(operation_id, "running")
    pending = room.post(f"/cases/{case_id}/motions", {"plan": plan})
    assert (pending.status_code, pending.json()["code"]) == (409, "plan_stale")
    room.robot.arrive()
    room.wait_for_status(operation_id, "succeeded")
    used = room.post(f"/cases/{case_id}/motions", {"plan": plan})
    assert used.json()["detail"] == f"plan {plan} is stale: a motion was made from it; request a new plan"
    assert len(room.robot.moves) == 1


def test_the_same_request_under_the_same_key_moves_once(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    answers = []

    def ask() -> None:
        answers.append(room.post(f"/cases/{case_id}/motions", {"plan": plan}, key="one-motion"))

    threads = [threading.Thread(target=ask) for _ in range(5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE_S)
    assert {(a.status_code, a.text) for a in answers} == {(202, answers[0].text)}
    room.wait_for_status(answers[0].json()["id"], "running")
    room.robot.arrive()
    room.wait_for_status(answers[0].json()["id"], "succeeded")
    assert len(room.robot.moves) == 1


def test_a_refusal_by_the_robot_leaves_the_plan_usable(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())

    def refuse(command: MoveCommand) -> CommandReply:
        return CommandReply(
            command_id=command.envelope.command_id,
            verdict="refused",
            code="out_of_workspace",
            message="leg 3 would be 54.2 mm long (limit 53.0 mm)",
            state=MotionState.LOCKED,
        )

    accept, room.robot.answers_moves = room.robot.answers_moves, refuse
    ended = room.wait_for_status(_move(room, case_id, plan), "failed")
    assert (ended["began"], ended["code"]) == (False, "out_of_workspace")
    assert "limit 53.0 mm" in str(ended["detail"])
    procedure = room.get(f"/cases/{case_id}").json()["procedure"]
    assert (procedure["stage"], procedure["aim"]) == ("positioning", "approved")
    room.robot.answers_moves = accept
    room.wait_for_status(_move(room, case_id, plan), "running")


def test_a_refusal_by_another_run_of_the_robot_service_proves_nothing(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    room.robot.answers_moves = lambda command: CommandReply(
        command_id=command.envelope.command_id,
        verdict="refused",
        code="wrong_boot_epoch",
        message="the command is for another boot",
        state=MotionState.DISCONNECTED,
    )
    operation_id = _move(room, case_id, plan)
    assert room.wait_for_status(operation_id, "unknown")["began"] is None
    room.robot.say(MotionState.DISCONNECTED, boot_epoch="robot-2", command_id=None, outcome="none")
    room.robot.say(MotionState.STOPPED, boot_epoch="robot-2", command_id=None, outcome="none")
    ended = room.wait_for_status(operation_id, "failed")
    assert (ended["code"], ended["began"]) == ("robot_restarted", True)


def test_a_state_of_an_earlier_run_of_the_robot_that_waited_says_nothing(room: Room) -> None:
    """States wait while the record takes nothing."""
    earlier = room.robot.state.model_copy(update={"boot_epoch": "robot-0"})
    plan = room.approved_plan(case_id := room.open_case())
    operation_id = _move(room, case_id, plan)
    room.wait_for_status(operation_id, "running")
    room.gateway.commands.follow(earlier)
    assert room.get(f"/operations/{operation_id}").json()["status"] == "running"


@pytest.mark.requirement("GW-10")
def test_a_command_without_an_answer_is_unknown_until_the_robot_tells(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    room.robot.answers_moves = room.robot.hang
    operation_id = _move(room, case_id, plan)
    unknown = room.wait_for_status(operation_id, "unknown")
    assert unknown["began"] is None
    assert "does not mean that it was not carried out" in str(unknown["detail"])
    for at_ns in (3 * 10**9, 3600 * 10**9, 0):  # somebody sets the robot's clock
        room.robot.say(MotionState.LOCKED, sent_at_ns=at_ns)
    room.robot.release.set()  # the robot was only slow, and carries it out now
    room.wait_for_status(operation_id, "running")
    room.robot.arrive()
    room.wait_for_status(operation_id, "succeeded")
    assert len(room.robot.moves) == 1


def test_an_unanswered_command_that_the_robot_can_no_longer_begin_has_failed(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    room.robot.answers_moves = room.robot.hang
    operation_id = _move(room, case_id, plan)
    room.wait_for_status(operation_id, "unknown")
    room.robot.say(MotionState.LOCKED, clock_s=(room.robot.state.clock_s or 0.0) + 3.0)
    ended = room.wait_for_status(operation_id, "failed")
    assert (ended["began"], ended["code"]) == (False, "not_executed")


def test_a_robot_that_restarts_during_a_motion_ends_it(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    operation_id = _move(room, case_id, plan)
    room.wait_for_status(operation_id, "running")
    room.robot.say(MotionState.UNREFERENCED, boot_epoch="robot-2", command_id=None, outcome="none")
    ended = room.wait_for_status(operation_id, "failed")
    assert (ended["code"], ended["began"]) == ("robot_restarted", True)


@pytest.mark.requirement("GW-11")
def test_hold_to_move_goes_on_while_renewed_and_stops_when_not(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    operation_id = _move(room, case_id, plan, hold_to_move=True)
    renewed = room.client.put(f"/api/v1/operations/{operation_id}/lease")
    assert renewed.json() == {"operation": operation_id, "expires_in_s": room.gateway.leases.lease_s}
    room.wait_for_status(operation_id, "stopped")
    assert room.robot.stops[0].reason == "the hold-to-move lease lapsed"
    room.log.wait_for_event(lambda e: e.kind is EventKind.STOP_REQUESTED)
    late = room.client.put(f"/api/v1/operations/{operation_id}/lease")
    assert (late.status_code, late.json()["code"]) == (409, "operation_ended")


def test_a_motion_without_hold_to_move_has_no_lease(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    operation_id = _move(room, case_id, plan)
    answer = room.client.put(f"/api/v1/operations/{operation_id}/lease")
    assert (answer.status_code, answer.json()["code"]) == (409, "no_lease")


@pytest.mark.parametrize("verb", ["get", "put"])
def test_an_unknown_operation_is_not_found(room: Room, verb: str) -> None:
    path = "/api/v1/operations/nothing" + ("/lease" if verb == "put" else "")
    answer = room.client.request(verb, path)
    assert (answer.status_code, answer.json()["code"]) == (404, "operation_not_found")
