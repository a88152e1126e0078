"""One case from opening to its end, over HTTP, with the other services on the bus."""

from collections.abc import Callable

import httpx
import pytest

from services.ui_api.core.events import EventKind
from shared.errors import ReasonCode
from shared.robot_states import MotionState, StopLatch
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.room import Room, wait_until
from tests.unit.services.ui_api.samples import OVERLAY_PNG


def test_a_case_runs_from_opening_to_finish(room: Room) -> None:
    case_id = room.open_case()
    plan = room.approved_plan(case_id)

    answer = room.post(f"/cases/{case_id}/motions", {"plan": plan})
    assert answer.status_code == 202
    assert answer.headers["location"] == f"/api/v1/operations/{answer.json()['id']}"
    operation_id = answer.json()["id"]
    running = room.wait_for_status(operation_id, "running")
    assert (running["status"], running["began"]) == ("running", True)
    assert room.get(f"/cases/{case_id}").json()["procedure"]["stage"] == "moving"

    room.robot.arrive()
    ended = room.wait_for_status(operation_id, "succeeded")
    assert (ended["deviation_mm"], ended["deviation_deg"]) == (0.01, 0.02)
    assert room.get(f"/cases/{case_id}").json()["procedure"]["stage"] == "aligned"

    image = room.image("after", case_id)
    verified = room.post(f"/cases/{case_id}/verifications", {"images": [image.sha256]})
    assert verified.status_code == 201, verified.text
    assert verified.json()["wires"][0]["exit_offset_mm"] == 0.3
    for step in ("drilled", "robot_removed", "finished"):
        recorded = room.post(f"/cases/{case_id}/steps", {"step": step})
        assert recorded.status_code == 201, recorded.text
    assert recorded.json()["procedure"]["stage"] == "finished"
    assert recorded.json()["procedure"]["allowed_actions"] == []
    kinds = [e.kind for e in room.gateway.record.events_after(0, case_id)]
    assert kinds.index(EventKind.PLAN_APPROVED) < kinds.index(EventKind.OPERATION_REQUESTED)
    assert len(room.robot.moves) == 1


def _assert_case_and_requests_agree(room: Room, case_id: str) -> list[str]:
    """Ask for everything that the case says is refused: each answer has the code, the reason and the remedy it said."""
    procedure = room.get(f"/cases/{case_id}").json()["procedure"]
    refused = [one for one in procedure["actions"] if one["verdict"] == "refused" and one["refused_by"] == "gateway"]
    newest = room.gateway.record.ledger.cases[case_id]
    plan = max(1, len(newest.plans))
    etag = f'"{newest.plans[-1].made.plan_sha256}"' if newest.plans else '"none"'
    path = f"/cases/{case_id}"
    ask: dict[str, Callable[[], httpx.Response]] = {
        "request_plan": lambda: room.post(
            f"{path}/plans", {"localisation": max(1, len(newest.localisations)), "hole_ids": ["distal"]}
        ),
        "approve_plan": lambda: room.post(f"{path}/plans/{plan}/approval", if_match=etag),
        "withdraw_approval": lambda: room.client.delete(f"/api/v1{path}/plans/{plan}/approval"),
        "start_motion": lambda: room.post(f"{path}/motions", {"plan": plan}),
        "verify": lambda: room.post(f"{path}/verifications", {"images": [samples.sha("image")]}),
        "change_setup": lambda: room.patch(path, {"side": "right"}),
        "record_step": lambda: room.post(f"{path}/steps", {"step": "mount_moved", "why": "it was"}),
        "withdraw_step": lambda: room.client.delete(f"/api/v1{path}/steps/1"),
        "reference": lambda: room.post("/robot/reference"),
        "acknowledge_stop": lambda: room.post("/robot/acknowledge-stop"),
        "reset": lambda: room.post("/robot/reset"),
    }
    for one in refused:
        if one["name"] in ask:
            answer = ask[one["name"]]()
            assert answer.json().get("code") == one["code"], (one, answer.text)
            assert answer.json()["detail"] == f"{one['reason']}; {one['remedy']}" or answer.status_code == 404
    return [one["name"] for one in refused]


@pytest.mark.requirement("GW-14")
def test_what_a_case_refuses_a_request_is_refused_with_the_same_code(room: Room) -> None:
    case_id = room.open_case()
    assert "request_plan" in _assert_case_and_requests_agree(room, case_id)
    plan = room.approved_plan(case_id)
    assert _assert_case_and_requests_agree(room, case_id) == ["approve_plan", "withdraw_step", "reference"]
    room.robot.say(MotionState.STOPPED, stop=StopLatch.LATCHED)
    room.log.wait_for_event(lambda e: getattr(e.data, "stop", "") == "latched")
    procedure = room.get(f"/cases/{case_id}").json()["procedure"]
    assert (procedure["next_action"], procedure["next"]) == (
        "acknowledge_stop",
        "A stop is in force: look why, then acknowledge it.",
    )
    assert "start_motion" in _assert_case_and_requests_agree(room, case_id)
    room.robot.say(MotionState.LOCKED, stop=StopLatch.CLEAR)
    room.log.wait_for_event(lambda e: getattr(e.data, "stop", "") == "clear" and e.sequence > 3)
    wait_until(lambda: "start_motion" in room.get(f"/cases/{case_id}").json()["procedure"]["allowed_actions"])
    room.post(f"/cases/{case_id}/steps", {"step": "wires_inserted", "why": "by hand"})
    assert {"request_plan", "start_motion", "reference"} <= {*_assert_case_and_requests_agree(room, case_id)}
    room.post(f"/cases/{case_id}/steps", {"step": "wires_removed"})
    operation_id = room.post(f"/cases/{case_id}/motions", {"plan": plan}).json()["id"]
    room.wait_for_status(operation_id, "running")
    assert {"verify", "change_setup", "record_step", "take_image"} <= {*_assert_case_and_requests_agree(room, case_id)}
    room.robot.arrive()
    room.wait_for_status(operation_id, "succeeded")
    _assert_case_and_requests_agree(room, case_id)
    room.post(f"/cases/{case_id}/steps", {"step": "robot_removed"})
    assert "verify" in _assert_case_and_requests_agree(room, case_id)
    room.post(f"/cases/{case_id}/steps", {"step": "abandoned"})
    _assert_case_and_requests_agree(room, case_id)


def test_an_approval_can_be_withdrawn_until_a_motion_begins(room: Room) -> None:
    plan = room.approved_plan(case_id := room.open_case())
    path = f"/api/v1/cases/{case_id}/plans/{plan}/approval"
    withdrawn = room.client.delete(path)
    assert (withdrawn.status_code, withdrawn.json()["approval"]) == (200, None)
    procedure = room.get(f"/cases/{case_id}").json()["procedure"]
    assert (procedure["phase"], procedure["next_action"], procedure["aim"]) == ("approval", "approve_plan", "planned")
    assert room.post(f"/cases/{case_id}/motions", {"plan": plan}).json()["code"] == "plan_not_approved"
    assert room.client.delete(path).json()["code"] == "plan_not_approved"
    kinds = [e.kind for e in room.gateway.record.events_after(0, case_id)]
    assert EventKind.APPROVAL_WITHDRAWN in kinds


def test_the_guide_alone_is_verified_and_drilling_is_then_in_order(room: Room) -> None:
    image = room.image("image", case_id := room.open_case())
    answer = room.post(f"/cases/{case_id}/verifications", {"images": [image.sha256], "of": "guide"})
    assert answer.status_code == 201, answer.text
    assert (answer.json()["of"], answer.json()["wires"]) == ("guide", [])
    procedure = room.get(f"/cases/{case_id}").json()["procedure"]
    assert (procedure["stage"], procedure["next"]) == ("verified", "Drill through the guide: distal.")
    assert room.post(f"/cases/{case_id}/steps", {"step": "drilled", "hole_ids": ["distal"]}).status_code == 201
    said = room.get(f"/cases/{case_id}").json()["procedure"]["next"]
    assert said.startswith("Drill what is left through the guide (no other was verified), or plan the move")


@pytest.mark.requirement("GW-04")
def test_a_guide_through_which_no_drill_would_pass_is_not_drilled_through(room: Room) -> None:
    image = room.image("image", case_id := room.open_case())
    room.registration.chance_to_pass = 0.4
    answer = room.post(f"/cases/{case_id}/verifications", {"images": [image.sha256], "of": "guide"})
    assert (answer.status_code, answer.json()["verdict"]) == (201, "accepted")
    assert room.get(f"/cases/{case_id}").json()["procedure"]["stage"] == "positioning"
    refused = room.post(f"/cases/{case_id}/steps", {"step": "drilled", "hole_ids": ["distal"]})
    assert refused.json()["code"] == "step_out_of_order"


def test_steps_recorded_by_mistake_are_taken_back_the_last_first(room: Room) -> None:
    case_id = room.open_case()
    path = f"/cases/{case_id}/steps"
    none = room.client.delete(f"/api/v1{path}/1")
    assert (none.status_code, none.json()["code"]) == (404, "step_not_found")
    room.post(path, {"step": "wires_inserted", "hole_ids": ["distal"], "why": "by hand"})
    room.post(path, {"step": "drilled", "why": "by hand"})
    room.image("image", case_id)
    assert room.client.delete(f"/api/v1{path}/1").json()["code"] == "step_not_undoable"
    after = room.client.delete(f"/api/v1{path}/2").json()["procedure"]
    assert (after["stage"], after["drilled_hole_ids"], after["wired_hole_ids"]) == ("positioning", [], ["distal"])
    assert room.client.delete(f"/api/v1{path}/1").json()["procedure"]["inside"] == []
    room.post(path, {"step": "robot_removed"})
    assert [(one["number"], one["step"]) for one in room.get(path).json()["items"]] == [(3, "robot_removed")]
    assert room.client.delete(f"/api/v1{path}/3").json()["procedure"]["stage"] == "positioning"
    room.post(path, {"step": "mount_moved"})
    refused = room.client.delete(f"/api/v1{path}/4")
    assert (refused.status_code, refused.json()["code"]) == (409, "step_not_undoable")
    kinds = [e.kind for e in room.gateway.record.events_after(0, case_id)]
    assert kinds.count(EventKind.STEP_WITHDRAWN) == 3


@pytest.mark.requirement("GW-03")
def test_images_of_the_other_side_allow_no_plan_until_that_is_settled(room: Room) -> None:
    case_id = room.open_case()
    header = room.imaging.store("other side", case_id).model_copy(update={"laterality": "right"})
    room.imaging.keep(header)
    room.imaging.publish(header)
    ledger = room.gateway.record.ledger
    room.log.wait_for(lambda: ledger.cases[case_id].image(header.sha256) is not None)
    epoch = room.registration.publish(header).registration_epoch
    room.log.wait_for(lambda: ledger.cases[case_id].knows_localisation(header.sha256, epoch))
    assert "request_plan" in _assert_case_and_requests_agree(room, case_id)
    answer = room.post(f"/cases/{case_id}/plans", {"localisation": 1, "hole_ids": ["distal"]})
    assert (answer.status_code, answer.json()["code"]) == (409, "laterality_mismatch")
    assert "the case is of the left side, and the newest image's header states the right side" in answer.text
    assert room.get(f"/cases/{case_id}").json()["procedure"]["next_action"] == "change_setup"
    room.image("from now on without a side", case_id)
    assert room.post(f"/cases/{case_id}/plans", {"localisation": 2, "hole_ids": ["distal"]}).status_code == 409
    room.patch(f"/cases/{case_id}", {"side": "right"})
    assert ledger.cases[case_id].side_of_images is None, "older images are of another set-up"


def test_the_robot_says_what_may_be_done_with_it_and_by_whom(room: Room) -> None:
    actions = {one["name"]: one for one in room.get("/robot").json()["actions"]}
    assert actions["stop"]["verdict"] == "allowed"
    assert (actions["reference"]["code"], actions["reference"]["refused_by"]) == ("nothing_to_do", "gateway")
    assert actions["reference"]["roles"] == ["technician", "surgeon"]
    refused = room.post("/robot/reference")
    assert (refused.status_code, refused.json()["code"]) == (409, "nothing_to_do")
    assert refused.json()["detail"] == "the robot is locked, referenced and free of faults; nothing is needed"
    assert (actions["reset"]["code"], actions["reset"]["refused_by"]) == ("nothing_to_do", "robot")
    assert room.post("/robot/reset").status_code == 202, "the robot is the judge of it"
    assert [command.verb for command in room.robot.plain] in ([], ["reset"])


def test_the_newest_localisation_tells_how_to_turn_the_c_arm(room: Room) -> None:
    case_id = room.open_case()
    assert room.get(f"/cases/{case_id}/alignment").status_code == 404
    image = room.image("one", case_id)
    alignment = room.get(f"/cases/{case_id}/alignment").json()
    assert alignment["c_arm_correction_deg"] == {"about_image_x": -1.2, "about_image_y": 0.4}
    assert alignment["tilts"][0] == {"id": "distal", "tilt_to_ray_deg": 2.1}
    assert (alignment["image"], alignment["validity"]) == (image.sha256, "current")


def test_a_localisation_is_what_locate_prints_plus_provenance(room: Room) -> None:
    case_id = room.open_case()
    image = room.image("one", case_id)
    room.imaging.send("two", case_id)
    room.log.wait_for(lambda: len(room.gateway.record.ledger.cases[case_id].images) == 2)
    body = room.get(f"/cases/{case_id}/localisations/1").json()
    assert body["schema"] == "distalock/localisation/1"
    assert body["provenance"]["registration_epoch"] == "registration-1.1"
    assert (body["validity"], body["stale_because"]) == ("stale", "a newer image has arrived")
    overlay = room.get(f"/images/{image.sha256}.png?view=overlay")
    assert (overlay.headers["content-type"], overlay.content) == ("image/png", OVERLAY_PNG)
    drawing = room.get(f"/cases/{case_id}/localisations/1/drawing").json()
    assert (drawing["schema"], drawing["image_sha256"]) == ("distalock/drawing/1", image.sha256)


def test_nothing_can_be_drawn_on_an_image_without_a_ring(room: Room) -> None:
    case_id = room.open_case()
    room.image("one", case_id, ReasonCode.RING_NOT_FOUND)
    answer = room.get(f"/cases/{case_id}/localisations/1/drawing")
    assert (answer.status_code, answer.json()["code"]) == (409, "no_drawing")
