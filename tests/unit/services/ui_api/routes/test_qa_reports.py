"""Quality reports over REST: asked of imaging, kept in the case."""

from tests.unit.services.ui_api.room import Room, new_key


def test_a_report_is_kept_as_json_and_as_a_page(room: Room) -> None:
    case_id = room.open_case()
    images = [room.image(name, case_id).sha256 for name in ("one", "two")]
    key = new_key()
    made = room.post(f"/cases/{case_id}/qa-reports", {"images": images}, key)
    assert made.status_code == 201, made.text
    assert (made.json()["schema"], made.json()["verdict"], made.json()["number"]) == ("distalock/qa/1", "good", 1)
    assert made.headers["location"].endswith(f"/cases/{case_id}/qa-reports/1")
    assert room.post(f"/cases/{case_id}/qa-reports", {"images": images}, key).json() == made.json()
    assert room.get(f"/cases/{case_id}/qa-reports/1").json() == made.json()
    assert room.get(f"/cases/{case_id}/qa-reports").json()["items"] == [made.json()]
    page = room.get(f"/cases/{case_id}/qa-reports/1.html")
    assert page.text.startswith("<!doctype html>")
    assert page.headers["content-type"] == "text/html; charset=utf-8"
    assert page.headers["content-security-policy"].startswith("default-src 'none'")


def test_imagings_refusal_and_unknown_things_are_problems(room: Room) -> None:
    case_id = room.open_case()
    image = room.image("one", case_id).sha256
    refused = room.post(f"/cases/{case_id}/qa-reports", {"images": [image]})
    assert (refused.status_code, refused.json()["code"]) == (409, "case_not_open")
    strange = room.post(f"/cases/{case_id}/qa-reports", {"images": ["0" * 64]})
    assert (strange.status_code, strange.json()["code"]) == (404, "image_not_found")
    for name in ("1", "1.html"):
        missing = room.get(f"/cases/{case_id}/qa-reports/{name}")
        assert (missing.status_code, missing.json()["code"]) == (404, "qa_report_not_found")
