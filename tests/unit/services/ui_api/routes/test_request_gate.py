"""What is refused before a route sees it, and what every answer carries."""

from collections.abc import Iterator

import httpx
import pytest

from tests.unit.services.ui_api.room import Room, open_room

CASES = "/api/v1/cases"
EVIL = {"Origin": "http://evil.example", "Sec-Fetch-Site": "cross-site", "Idempotency-Key": "1"}


def refused(answer: httpx.Response, status: int, code: str) -> None:
    assert answer.status_code == status, answer.text
    assert answer.json()["code"] == code
    assert answer.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize("method", ["GET", "POST"])
def test_a_foreign_name_is_refused(quiet_room: Room, method: str) -> None:
    refused(quiet_room.client.request(method, CASES, headers={"Host": "evil.example"}), 421, "host_not_allowed")


@pytest.mark.requirement("SEC-03")
def test_a_foreign_page_changes_nothing(quiet_room: Room) -> None:
    refused(quiet_room.client.post(CASES, json={}, headers=EVIL), 403, "cross_site_request")


@pytest.mark.requirement("GW-05")
def test_nobody_is_refused_a_stop(quiet_room: Room) -> None:
    answer = quiet_room.client.post("/api/v1/robot/stop", headers=EVIL | {"Host": "evil.example"})
    assert answer.json()["confirmed"] is True


@pytest.mark.parametrize("path", [CASES, "/healthz", "/openapi.json", "/api/v1/parts/ring-120", "/nowhere"])
def test_every_answer_carries_the_headers(quiet_room: Room, path: str) -> None:
    headers = quiet_room.client.get(path).headers
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cache-control"] == "no-store"
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
    assert "strict-transport-security" not in headers
    assert "server" not in headers


_CONSOLE = "https://console.hospital:8443"


@pytest.fixture(scope="module")
def room_with_console(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    with open_room(tmp_path_factory.mktemp("console"), cors_origins=(_CONSOLE,)) as room:
        yield room


def test_a_console_of_another_origin_is_let_in_by_setting(room_with_console: Room) -> None:
    asked = {"Origin": _CONSOLE, "Access-Control-Request-Method": "POST", "Sec-Fetch-Site": "cross-site"}
    first = room_with_console.client.options(CASES, headers=asked)
    assert (first.status_code, first.headers["access-control-allow-origin"]) == (204, _CONSOLE)
    assert "If-Match" in first.headers["access-control-allow-headers"]
    read = room_with_console.client.get(CASES, headers={"Origin": _CONSOLE})
    assert (read.status_code, read.headers["access-control-allow-origin"]) == (200, _CONSOLE)
    assert "Case-ETag" in read.headers["access-control-expose-headers"]
    assert "access-control-allow-credentials" not in read.headers
    sent = room_with_console.client.post(CASES, json={}, headers={"Origin": _CONSOLE, "Sec-Fetch-Site": "cross-site"})
    refused(sent, 400, "idempotency_key_missing")


def test_every_other_origin_stays_out(room_with_console: Room, quiet_room: Room) -> None:
    for room, origin in ((room_with_console, "https://console.hospital"), (quiet_room, _CONSOLE)):
        headers = {"Origin": origin, "Access-Control-Request-Method": "POST"}
        assert "access-control-allow-origin" not in room.client.options(CASES, headers=headers).headers
        assert "access-control-allow-origin" not in room.client.get(CASES, headers=headers).headers
        refused(room.client.post(CASES, json={}, headers={"Origin": origin}), 403, "cross_site_request")
