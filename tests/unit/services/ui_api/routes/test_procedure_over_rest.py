"""One case from opening to its end, over HTTP, with the other services on the bus."""

from services.ui_api.core.events import EventKind
from tests.unit.services.ui_api.room import Room
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
