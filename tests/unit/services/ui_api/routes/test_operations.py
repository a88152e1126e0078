"""What takes time: how far it is, and how it is ended."""

from collections.abc import Mapping
from pathlib import Path

import pytest

from services.ui_api.core.computation_event_data import ComputationRequested
from services.ui_api.core.events import EventDraft, EventKind
from shared.messages.base import decode
from shared.messages.registration import Plan
from shared.messages.robot import MotionState, PlatformPoseMessage
from tests.unit.services.ui_api.fakes import PATIENCE_S
from tests.unit.services.ui_api.room import Room, open_room, wait_until

PLAN = {"plan": {"localisation": 1, "hole_ids": ["proximal", "distal"]}}


def begin(room: Room, case_id: str, body: Mapping[str, object]) -> str:
    """A computation that has begun; its operation's id."""
    answer = room.post(f"/cases/{case_id}/operations", body)
    assert answer.status_code == 202, answer.text
    operation = answer.json()
    assert answer.headers["location"] == f"/api/v1/operations/{operation['id']}"
    assert (operation["status"], operation["ended_by"]) == ("running", "cancel")
    assert operation["progress"] == {"step": 1, "steps": 3, "says": "waits for its turn", "fraction": None}
    return str(operation["id"])


def ended(room: Room, operation_id: str) -> dict[str, object]:
    """An operation once it has ended."""
    computations = room.gateway.record.ledger
    room.log.wait_for(lambda: computations.computations[operation_id].ended)
    answer: dict[str, object] = room.get(f"/operations/{operation_id}").json()
    assert answer["ended_by"] is None
    return answer


def held_plan(room: Room) -> tuple[str, str]:
    """A case, and a plan on which registration is at work until `hold` is set."""
    case_id = room.open_case()
    room.image("image", case_id)
    room.registration.hold.clear()
    operation_id = begin(room, case_id, PLAN)
    assert room.registration.asked.wait(PATIENCE_S)
    return case_id, operation_id


def test_a_plan_is_made_while_nobody_waits_for_it(room: Room) -> None:
    case_id, operation_id = held_plan(room)
    under_way = room.get(f"/operations/{operation_id}").json()
    progress = {"step": 2, "steps": 3, "says": "registration looks for the move", "fraction": None}
    assert (under_way["verb"], under_way["status"], under_way["progress"]) == ("plan", "running", progress)
    assert [one["id"] for one in room.get("/operations?status=running").json()["items"]] == [operation_id]
    room.registration.hold.set()
    made = ended(room, operation_id)
    assert (made["status"], made["result"]) == ("succeeded", f"/api/v1/cases/{case_id}/plans/1")
    assert made["progress"] == {"step": 3, "steps": 3, "says": "has ended: succeeded", "fraction": 1.0}
    assert room.client.get(str(made["result"])).json()["number"] == 1
    kinds = [event.kind for event in room.gateway.record.events_after(0)]
    begun = kinds.index(EventKind.COMPUTATION_REQUESTED)
    assert kinds[begun:] == [
        EventKind.COMPUTATION_REQUESTED,
        EventKind.COMPUTATION_PROGRESSED,
        EventKind.PLAN_MADE,
        EventKind.COMPUTATION_ENDED,
    ]


def test_what_was_cancelled_leaves_nothing_behind(room: Room) -> None:
    case_id, operation_id = held_plan(room)
    answer = room.post(f"/operations/{operation_id}/cancel", key="once")
    assert answer.status_code == 200, answer.text
    cancelled = answer.json()
    assert (cancelled["status"], cancelled["code"]) == ("cancelled", "cancelled")
    assert cancelled["detail"] == "cancelled by demo: nothing of it is kept"
    assert room.post(f"/operations/{operation_id}/cancel", key="once").json() == cancelled
    late = room.post(f"/operations/{operation_id}/cancel")
    assert (late.status_code, late.json()["code"]) == (409, "operation_ended")
    room.registration.hold.set()
    after = begin(room, case_id, PLAN)  # made after registration has answered for the first
    assert ended(room, after)["result"] == f"/api/v1/cases/{case_id}/plans/1"
    assert room.get(f"/cases/{case_id}").json()["plans"] == 1
    assert room.get(f"/operations/{operation_id}").json() == cancelled


@pytest.mark.parametrize(("of", "kind"), [("verification", "verifications"), ("qa_report", "qa-reports")])
def test_verifications_and_quality_reports_too(room: Room, of: str, kind: str) -> None:
    case_id = room.open_case()
    images = [room.image(name, case_id).sha256 for name in ("first", "second")]
    made = ended(room, begin(room, case_id, {of: {"images": images}}))
    assert made["result"] == f"/api/v1/cases/{case_id}/{kind}/1"
    assert room.client.get(str(made["result"])).status_code == 200
    sentences = [entry["what"] for entry in room.get(f"/cases/{case_id}/timeline").json()["items"]]
    assert sum(sentence.startswith("Begun without waiting for it: ") for sentence in sentences) == 1


def test_what_registration_refuses_fails_with_its_code_and_sentence(room: Room) -> None:
    case_id = room.open_case()
    room.image("image", case_id)
    room.registration.refusal = ("out_of_reach", "leg 3 is 2 mm too short; move the mount")
    failed = ended(room, begin(room, case_id, PLAN))
    assert (failed["status"], failed["code"], failed["result"]) == ("failed", "out_of_reach", None)
    assert failed["detail"] == "leg 3 is 2 mm too short; move the mount"


def test_a_service_that_is_gone_ends_it(room: Room) -> None:
    case_id = room.open_case()
    room.image("image", case_id)
    room.registration.__exit__(None, None, None)
    failed = ended(room, begin(room, case_id, PLAN))
    assert (failed["status"], failed["code"]) == ("failed", "no_reply")


@pytest.mark.parametrize(
    ("body", "status", "code"),
    [
        ({}, 422, "request_invalid"),
        ({"plan": PLAN["plan"], "qa_report": {"images": ["a" * 64]}}, 422, "request_invalid"),
        (PLAN, 404, "localisation_not_found"),
        ({"verification": {"images": ["a" * 64]}}, 404, "image_not_found"),
    ],
)
def test_what_can_be_refused_at_once_is(room: Room, body: dict[str, object], status: int, code: str) -> None:
    case_id = room.open_case()
    answer = room.post(f"/cases/{case_id}/operations", body)
    assert (answer.status_code, answer.json()["code"]) == (status, code), answer.text
    assert room.get("/operations").json()["items"] == []


def test_not_more_than_a_few_at_once(room: Room) -> None:
    case_id, first = held_plan(room)
    others = [begin(room, case_id, PLAN) for _ in range(7)]
    answer = room.post(f"/cases/{case_id}/operations", PLAN)
    assert (answer.status_code, answer.json()["code"]) == (409, "too_many_computations")
    for operation_id in (first, *others):
        assert room.post(f"/operations/{operation_id}/cancel").status_code == 200
    room.registration.hold.set()


def test_a_restarted_gateway_says_what_it_did_not_finish(tmp_path: Path) -> None:
    with open_room(tmp_path) as room:
        _, operation_id = held_plan(room)
        room.registration.hold.set()
        with room.gateway.record.write() as unit:
            unit.append(EventDraft(ComputationRequested("left-over", "verify", "some"), None, "demo"))
    with open_room(tmp_path) as room:
        failed = room.get("/operations/left-over").json()
        assert (failed["status"], failed["code"]) == ("failed", "gateway_restarted")
        assert operation_id in {one["id"] for one in room.get("/operations").json()["items"]}


def test_a_motion_says_how_much_of_its_way_lies_behind_it_and_is_ended_by_a_stop_alone(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    operation_id = room.post(f"/cases/{case_id}/motions", {"plan": plan}).json()["id"]
    room.wait_for_status(operation_id, "running")
    entry = room.gateway.record.ledger.cases[case_id].plans[0].made
    way = decode(Plan, room.gateway.record.document(entry.plan_sha256))
    start, target = way.start_pose.value().as_array(), way.target_pose.value().as_array()
    names = list(PlatformPoseMessage.model_fields)
    quarter = PlatformPoseMessage(**dict(zip(names, start + 0.25 * (target - start), strict=True)))
    seen = room.robot.say(MotionState.MOVING, outcome="moving", pose=quarter)
    wait_until(lambda: room.gateway.view.newest().state.sequence == seen.sequence)  # type: ignore[union-attr]
    under_way = room.get(f"/operations/{operation_id}").json()
    assert under_way["ended_by"] == "stop"
    assert (under_way["progress"]["step"], under_way["progress"]["says"]) == (2, "the robot moves")
    assert under_way["progress"]["fraction"] == pytest.approx(0.25)
    answer = room.post(f"/operations/{operation_id}/cancel")
    assert (answer.status_code, answer.json()["code"]) == (409, "ended_by_stop")
    assert "POST /robot/stop" in answer.json()["detail"]
    assert room.robot.stops == []
    room.robot.arrive()
    reached = room.wait_for_status(operation_id, "succeeded")
    assert reached["progress"] == {"step": 3, "steps": 3, "says": "has ended: succeeded", "fraction": 1.0}


def test_nothing_is_cancelled_that_takes_but_a_moment(room: Room) -> None:
    room.robot.say(MotionState.STOPPED, stop="latched")
    room.log.wait_for_event(lambda e: e.kind is EventKind.ROBOT_CHANGED)
    room.robot.plain_is_held = True
    operation_id = room.post("/robot/acknowledge-stop").json()["id"]
    assert room.get(f"/operations/{operation_id}").json()["ended_by"] is None
    answer = room.post(f"/operations/{operation_id}/cancel")
    assert (answer.status_code, answer.json()["code"]) == (409, "not_cancellable")
    room.robot.release.set()
