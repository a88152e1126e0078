"""Every error is a problem document with a stable code; health tells what is missing."""

import json
import re
from pathlib import Path

import pytest

from services.ui_api.routes.body_limit import LARGEST_BODY_BYTES
from services.ui_api.routes.motion_views import says_simulated
from tests.unit.services.ui_api import samples
from tests.unit.services.ui_api.room import Room, open_room, wait_until


@pytest.mark.parametrize(
    ("method", "path", "status", "code"),
    [
        ("GET", "/nothing", 404, "not_found"),
        ("GET", "/api/v1/nothing", 404, "not_found"),
        ("DELETE", "/api/v1/cases", 405, "method_not_allowed"),
        ("POST", "/api/v1/cases", 400, "idempotency_key_missing"),
        ("GET", "/api/v1/cases?limit=0", 422, "request_invalid"),
        ("GET", "/api/v1/cases/none/plans/first", 422, "request_invalid"),
        ("GET", "/api/v1/cases?cursor=YWZ0ZXI6wrI", 400, "cursor_invalid"),
        ("GET", "/api/v1/cases?cursor=%C3%A9", 400, "cursor_invalid"),
        ("GET", "/api/v1/cases?open=true", 400, "unknown_parameter"),
        ("GET", "/api/v1/cases?limit=1&limit=2", 400, "repeated_parameter"),
        ("GET", "/api/v1/robot?x=", 400, "unknown_parameter"),
        ("GET", "/healthz?x=1", 400, "unknown_parameter"),
        ("GET", "/api/v1/events?after=9223372036854775808", 422, "request_invalid"),
    ],
)
def test_every_error_is_a_problem_document(quiet_room: Room, method: str, path: str, status: int, code: str) -> None:
    answer = quiet_room.client.request(method, path)
    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    document = answer.json()
    assert (document["status"], document["code"]) == (status, code)
    assert document["type"] == f"urn:distalock:problem:{code}"
    assert document["instance"] == path.split("?")[0]
    assert document["detail"]


@pytest.mark.parametrize(
    ("path", "methods"),
    [
        ("/api/v1/robot", "GET"),
        ("/api/v1/cases", "GET, POST"),
        ("/api/v1/cases/none", "GET, PATCH"),
        ("/healthz", "GET"),
        ("/openapi.json", "GET"),
    ],
)
def test_method_not_allowed_names_the_methods_that_are(quiet_room: Room, path: str, methods: str) -> None:
    answer = quiet_room.client.delete(path)
    assert (answer.status_code, answer.headers["allow"]) == (405, methods)
    assert answer.json()["detail"] == f"{path} has no DELETE; it has {methods}"


def test_an_unknown_parameter_is_named_with_those_there_are(quiet_room: Room) -> None:
    detail = quiet_room.client.get("/api/v1/cases?open=true").json()["detail"]
    assert (
        detail == "GET /api/v1/cases has no query parameter 'open'; it has cursor, limit, status, since, sort, fields"
    )
    assert quiet_room.client.post("/api/v1/robot/stop?now=yes").status_code == 200


@pytest.mark.parametrize(
    ("kind", "found"), [(None, "no Content-Type"), ("text/plain", "the Content-Type 'text/plain'")]
)
def test_a_body_that_does_not_say_that_it_is_json_is_refused(quiet_room: Room, kind: str | None, found: str) -> None:
    headers = {"Idempotency-Key": "k"} | ({} if kind is None else {"Content-Type": kind})
    answer = quiet_room.client.post("/api/v1/cases", content="{}", headers=headers)
    assert (answer.status_code, answer.json()["code"]) == (415, "content_type_unsupported")
    assert answer.json()["detail"] == f"the body has {found}; send Content-Type: application/json"


@pytest.mark.parametrize("body", ["{", "[]", '"x"', "", '{"side": NaN}'])
def test_a_body_that_is_no_object_is_refused(quiet_room: Room, body: str) -> None:
    headers = {"Idempotency-Key": "k", "Content-Type": "application/json"}
    answer = quiet_room.client.post("/api/v1/cases", content=body, headers=headers)
    assert (answer.status_code, answer.json()["code"]) == (422, "request_invalid"), answer.text


def test_half_a_character_in_a_part_is_refused(quiet_room: Room) -> None:
    content = json.dumps(samples.case_body(ring={"schema": "\ud800"}))
    headers = {"Idempotency-Key": "k", "Content-Type": "application/json"}
    answer = quiet_room.client.post("/api/v1/cases", content=content, headers=headers)
    assert (answer.status_code, answer.json()["code"]) == (422, "part_file_invalid")
    assert r"ring 'inline': '\ud800' is half a character" in answer.json()["detail"]


def test_a_body_that_is_too_large_is_refused_and_a_stop_is_not(room: Room) -> None:
    large = b'{"why": "' + b"x" * LARGEST_BODY_BYTES + b'"}'
    headers = {"Idempotency-Key": "k", "Content-Type": "application/json"}
    for content in (large, iter([large])):
        answer = room.client.post("/api/v1/cases", content=content, headers=headers)
        assert (answer.status_code, answer.json()["code"]) == (413, "body_too_large"), answer.text
        assert f"the limit is {LARGEST_BODY_BYTES} bytes" in answer.json()["detail"]
    assert room.client.post("/api/v1/robot/stop", content=large).json()["confirmed"] is True


def test_all_that_is_wrong_with_a_body_is_listed(quiet_room: Room) -> None:
    answer = quiet_room.post("/cases", samples.case_body(side="middle", bone="skull"))
    places = {e["place"] for e in answer.json()["errors"]}
    assert places == {"body.side", "body.bone"}
    assert answer.json()["detail"].endswith("(and 1 more)")


def test_a_fault_is_a_problem_without_its_inside(room: Room) -> None:
    room.gateway.record.close()
    room.gateway.record.ledger.cases["broken"] = None  # type: ignore[assignment]  # what cannot happen
    answer = room.get("/cases/broken")
    assert (answer.status_code, answer.json()["code"]) == (404, "case_not_found")
    listed = room.get("/cases")
    assert (listed.status_code, listed.json()["code"]) == (500, "internal_error")
    assert "AttributeError" not in listed.text
    del room.gateway.record.ledger.cases["broken"]


def test_healthz_tells_that_the_process_runs(quiet_room: Room) -> None:
    assert quiet_room.client.get("/healthz").json()["status"] == "ok"


def test_metrics_count_requests_by_route(room: Room) -> None:
    room.get("/cases/none")
    text = room.client.get("/metrics").text
    assert 'distalock_http_requests_total{method="GET",route="/api/v1/cases/{case_id}",status="404"} 1.0' in text
    assert 'distalock_service_alive{service="robot"} 1.0' in text


def test_metrics_show_how_busy_the_front_is(room: Room) -> None:
    open_connections = re.compile(r'^distalock_front\{figure="connections"\} [1-9]', re.MULTILINE)
    wait_until(lambda: open_connections.search(room.client.get("/metrics").text) is not None)


def test_a_robot_that_fell_silent_is_stale_and_moves_nothing(tmp_path: Path) -> None:
    with open_room(tmp_path, robot_state_stale_after_s=0.001) as room:
        assert room.get("/robot").json()["validity"] == "stale"
        refused = room.post("/robot/reference")
        assert (refused.status_code, refused.json()["code"]) == (503, "robot_state_stale")
        assert "limit 0.001 s" in refused.json()["detail"]
        assert room.robot.plain == []


def test_devices_say_themselves_whether_they_are_simulated() -> None:
    assert says_simulated("") is None
    assert says_simulated("(c) Physik Instrumente, C-887.52, 0, 2.0") is False
    assert says_simulated("distalock, Virtual hexapod, 1") is True
