"""Plans and their approval."""

import pytest

from services.ui_api.core.events import EventKind
from shared.errors import ReasonCode
from shared.messages.base import encode
from shared.messages.registration import PlanRequest
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.room import Room

_BOTH = {"localisation": 1, "hole_ids": ["proximal", "distal"]}


def _planned(room: Room) -> tuple[str, str]:
    """A case with one plan; the case's id and the plan's ETag."""
    room.image("image", case_id := room.open_case())
    answer = room.post(f"/cases/{case_id}/plans", _BOTH)
    assert answer.status_code == 201, answer.text
    return case_id, answer.headers["etag"]


def test_a_plan_is_kept_as_registration_made_it(room: Room) -> None:
    case_id, etag = _planned(room)
    request = room.registration.plan_requests[0]
    assert request == PlanRequest(case_id=case_id, image_sha256=samples.sha("image"), hole_ids=("proximal", "distal"))
    read = room.get(f"/cases/{case_id}/plans/1")
    expected = samples.plan(request, "registration-1.1")
    assert read.headers["etag"] == etag == f'"{expected.sha256()}"'
    assert read.json()["plan"]["target_pose"]["x_mm"] == 2.0
    assert (read.json()["validity"], read.json()["approval"]) == ("current", None)
    assert room.gateway.record.document(expected.sha256()) == encode(expected)


def test_a_repeated_request_asks_registration_once(room: Room) -> None:
    room.image("image", case_id := room.open_case())
    answers = [room.post(f"/cases/{case_id}/plans", _BOTH, key="one-plan") for _ in range(2)]
    assert answers[0].text == answers[1].text
    assert answers[0].headers["etag"] == answers[1].headers["etag"]
    assert len(room.registration.plan_requests) == 1


@pytest.mark.requirement("GW-01")
def test_approval_quotes_the_hash_of_the_plan(room: Room) -> None:
    case_id, etag = _planned(room)
    path = f"/cases/{case_id}/plans/1/approval"
    missing = room.post(path)
    assert (missing.status_code, missing.json()["code"]) == (428, "precondition_required")
    for wrong in ('"' + "0" * 64 + '"', "*", f"W/{etag}", f"{etag}, {etag}"):
        refused = room.post(path, if_match=wrong)
        assert (refused.status_code, refused.json()["code"]) == (412, "plan_hash_mismatch"), wrong
    bare = room.post(path, if_match=etag.strip('"')).json()
    assert "quotation marks" in bare["detail"]
    approved = room.post(path, if_match=etag)
    assert (approved.status_code, approved.json()["approved_by"]) == (201, "demo")
    again = room.post(path, if_match=etag)
    assert (again.status_code, again.json()["code"]) == (409, "plan_already_approved")
    assert room.get(f"/cases/{case_id}/plans/1").json()["approval"]["approved_by"] == "demo"


@pytest.mark.requirement("GW-02")
def test_a_stale_plan_cannot_be_approved(room: Room) -> None:
    case_id, etag = _planned(room)
    room.image("newer", case_id)
    answer = room.post(f"/cases/{case_id}/plans/1/approval", if_match=etag)
    assert (answer.status_code, answer.json()["code"]) == (409, "plan_stale")
    assert room.get(f"/cases/{case_id}/plans/1").json()["stale_because"] == "a newer image has arrived"


def test_a_newer_plan_takes_the_place_of_an_older_one(room: Room) -> None:
    case_id, etag = _planned(room)
    room.post(f"/cases/{case_id}/plans", {"localisation": 1, "hole_ids": ["distal"]})
    answer = room.post(f"/cases/{case_id}/plans/1/approval", if_match=etag)
    assert (answer.status_code, answer.json()["code"]) == (409, "plan_stale")
    assert "plan 2 was made after it" in answer.json()["detail"]
    assert [p["number"] for p in room.get(f"/cases/{case_id}/plans").json()["items"]] == [1, 2]


@pytest.mark.parametrize(
    ("body", "status", "code"),
    [
        ({"localisation": 2, "hole_ids": ["distal"]}, 404, "localisation_not_found"),
        ({"localisation": 1, "hole_ids": ["third"]}, 422, "unknown_hole"),
        ({"localisation": 1, "hole_ids": []}, 422, "request_invalid"),
        ({"localisation": "1", "hole_ids": ["distal"]}, 422, "request_invalid"),
    ],
)
def test_what_a_plan_cannot_be_made_from(room: Room, body: dict[str, object], status: int, code: str) -> None:
    room.image("image", case_id := room.open_case())
    answer = room.post(f"/cases/{case_id}/plans", body)
    assert (answer.status_code, answer.json()["code"]) == (status, code), answer.text
    assert room.registration.plan_requests == []


def test_no_plan_is_made_from_a_rejected_localisation(room: Room) -> None:
    room.image("image", case_id := room.open_case(), ReasonCode.NAIL_NOT_FOUND)
    answer = room.post(f"/cases/{case_id}/plans", _BOTH)
    assert (answer.status_code, answer.json()["code"]) == (409, "localisation_rejected")
    assert "nail_not_found" in answer.json()["detail"]


def test_no_plan_is_made_from_an_older_localisation(room: Room) -> None:
    case_id = room.open_case()
    room.image("one", case_id)
    room.image("two", case_id)
    answer = room.post(f"/cases/{case_id}/plans", _BOTH)
    assert (answer.status_code, answer.json()["code"]) == (409, "localisation_stale")


def test_a_plan_may_rest_on_several_localisations(room: Room) -> None:
    case_id = room.open_case()
    for name, reasons in (("one", ()), ("two", ()), ("three", (ReasonCode.UNCERTAINTY_TOO_LARGE,))):
        room.image(name, case_id, *reasons)
    body = {"localisation": 3, "hole_ids": ["distal"], "localisations": [2, 1, 3]}
    answer = room.post(f"/cases/{case_id}/plans", body)
    assert answer.status_code == 201, answer.text
    request = room.registration.plan_requests[0]
    assert request.image_sha256 == samples.sha("three")
    assert request.earlier_image_sha256 == (samples.sha("one"), samples.sha("two"))
    assert request.verified_image_sha256 == ()
    unknown = room.post(f"/cases/{case_id}/plans", body | {"localisations": [4]})
    assert (unknown.status_code, unknown.json()["code"]) == (404, "localisation_not_found")
    stale = room.post(f"/cases/{case_id}/plans", body | {"localisation": 2})
    assert (stale.status_code, stale.json()["code"]) == (409, "localisation_stale")


def test_a_plan_may_correct_what_the_last_verification_found(room: Room) -> None:
    room.image("image", case_id := room.open_case())
    images = [samples.sha("image")]
    for _ in range(2):
        assert room.post(f"/cases/{case_id}/verifications", {"images": images}).status_code == 201
    body = {"localisation": 1, "hole_ids": ["distal"], "verification": 2}
    assert room.post(f"/cases/{case_id}/plans", body).status_code == 201
    assert room.registration.plan_requests[0].verified_image_sha256 == tuple(images)
    older = room.post(f"/cases/{case_id}/plans", body | {"verification": 1})
    assert (older.status_code, older.json()["code"]) == (409, "verification_stale")
    assert "verification 2 is newer than 1" in older.json()["detail"]
    unknown = room.post(f"/cases/{case_id}/plans", body | {"verification": 3})
    assert (unknown.status_code, unknown.json()["code"]) == (404, "verification_not_found")


def test_a_refusal_by_registration_is_told_and_recorded(room: Room) -> None:
    room.image("image", case_id := room.open_case())
    room.registration.refusal = ("out_of_reach", "leg 3 would be 54.2 mm long (limit 53.0 mm); move the mount")
    answer = room.post(f"/cases/{case_id}/plans", _BOTH)
    assert (answer.status_code, answer.json()["code"]) == (409, "out_of_reach")
    assert answer.json()["detail"] == room.registration.refusal[1]
    assert room.gateway.record.events_after(0, case_id)[-1].kind is EventKind.PLAN_REFUSED


def test_without_registration_there_is_no_plan_and_the_key_stays_free(room: Room) -> None:
    room.image("image", case_id := room.open_case())
    room.router.cut()
    answer = room.post(f"/cases/{case_id}/plans", _BOTH, key="again")
    assert (answer.status_code, answer.json()["code"]) == (504, "no_reply")
    room.router.restore()
    assert room.post(f"/cases/{case_id}/plans", _BOTH, key="again").status_code == 201


def test_a_verification_that_registration_refuses_is_told_and_recorded(room: Room) -> None:
    image = room.image("image", case_id := room.open_case())
    room.registration.refusal = ("unknown_image", "image is not known; take it again")
    answer = room.post(f"/cases/{case_id}/verifications", {"images": [image.sha256]})
    assert (answer.status_code, answer.json()["code"]) == (409, "unknown_image")
    assert room.gateway.record.events_after(0, case_id)[-1].kind is EventKind.VERIFICATION_REFUSED


def test_verifications_are_kept_and_listed(room: Room) -> None:
    image = room.image("image", case_id := room.open_case())
    path = f"/cases/{case_id}/verifications"
    made = room.post(path, {"images": [image.sha256]})
    assert made.headers["location"] == f"/api/v1{path}/1"
    assert room.get(f"{path}/1").json() == made.json() == room.get(path).json()["items"][0]
    assert room.get(f"{path}/2").json()["code"] == "verification_not_found"
    unknown = room.post(path, {"images": [samples.sha("other")]})
    assert (unknown.status_code, unknown.json()["code"]) == (404, "image_not_found")


def test_who_approves_is_who_is_signed_in_whatever_the_body_says(room: Room) -> None:
    case_id, etag = _planned(room)
    answer = room.post(f"/cases/{case_id}/plans/1/approval", {"approved_by": "Dr B"}, if_match=etag)
    assert (answer.json()["approved_by"], answer.json()["authenticated_by"]) == ("demo", "simulation_token")
