"""An image on its way to its localisation is followed like an operation."""

from services.ui_api.core.event_data import ImageSkipped
from services.ui_api.core.events import EventDraft
from shared.errors import ReasonCode
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.room import Room, wait_until


def way(room: Room, image_id: str) -> dict[str, object]:
    operation_id = room.get(f"/images/{image_id}").json()["operation"]
    found: dict[str, object] = room.get(f"/operations/{operation_id}").json()
    assert found["id"] == operation_id
    return found


def received(room: Room, name: str, case_id: str) -> str:
    """An image of which nothing is reported yet."""
    header = room.imaging.send(name, case_id)
    wait_until(lambda: room.gateway.record.ledger.cases[case_id].image(header.sha256) is not None)
    return header.sha256


def test_a_localised_image_has_succeeded_with_the_localisation_as_its_result(room: Room) -> None:
    case_id = room.open_case()
    image = room.image("one", case_id)
    found = way(room, image.sha256)
    assert (found["verb"], found["status"], found["case_id"]) == ("localise", "succeeded", case_id)
    assert room.get(str(found["result"]).removeprefix("/api/v1")).json()["number"] == 1
    assert isinstance(found["ended_at_ns"], int)
    assert found["progress"]["fraction"] == 1.0  # type: ignore[index]
    assert found in room.get("/operations?status=succeeded").json()["items"]


def test_a_rejected_localisation_is_a_result_too_and_says_why(room: Room) -> None:
    case_id = room.open_case()
    image = room.image("one", case_id, ReasonCode.GUIDE_NOT_FOUND)
    found = way(room, image.sha256)
    assert (found["status"], found["detail"]) == ("succeeded", "it was rejected: guide_not_found")


def test_an_image_under_way_says_what_is_done_with_it_and_cannot_be_cancelled(room: Room) -> None:
    case_id = room.open_case()
    image_id = received(room, "slow", case_id)
    found = way(room, image_id)
    assert (found["status"], found["result"], found["ended_at_ns"], found["ended_by"]) == ("running", None, None, None)
    assert found["progress"] == {"step": 1, "steps": 3, "says": "imaging calibrates the image", "fraction": None}
    refused = room.post(f"/operations/{found['id']}/cancel")
    assert (refused.status_code, refused.json()["code"]) == (409, "not_cancellable")
    lease = room.client.put(f"/api/v1/operations/{found['id']}/lease")
    assert (lease.status_code, lease.json()["code"]) == (409, "no_lease")


def test_what_is_skipped_has_failed_and_what_a_newer_image_replaced_was_cancelled(room: Room) -> None:
    case_id = room.open_case()
    ways = dict[str, dict[str, object]]()
    for code in ("no_ring", "superseded"):
        image_id = received(room, code, case_id)
        room.gateway.record.append(
            EventDraft(ImageSkipped(image_id, "localisation", code, "it is so"), case_id, "registration")
        )
        ways[code] = way(room, image_id)
    assert (ways["no_ring"]["status"], ways["no_ring"]["code"]) == ("failed", "no_ring")
    assert ways["superseded"]["status"] == "cancelled"
    assert ways["no_ring"]["detail"] == "it is so"


def test_an_image_that_there_is_not_has_no_way(room: Room) -> None:
    for operation_id in (f"localise-{samples.sha('none')}", samples.sha("none")):
        assert room.get(f"/operations/{operation_id}").json()["code"] == "operation_not_found"
