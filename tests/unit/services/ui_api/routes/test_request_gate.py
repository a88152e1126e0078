"""What is refused before a route sees it, and what every answer carries."""

import httpx
import pytest

from tests.unit.services.ui_api.room import Room

CASES = "/api/v1/cases"
EVIL = {"Origin": "http://evil.example", "Sec-Fetch-Site": "cross-site", "Idempotency-Key": "1"}


def refused(answer: httpx.Response, status: int, code: str) -> None:
    assert answer.status_code == status, answer.text
    assert answer.json()["code"] == code
    assert answer.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize("method", ["GET", "POST"])
def test_a_foreign_name_is_refused(quiet_room: Room, method: str) -> None:
    refused(quiet_room.client.request(method, CASES, headers={"Host": "evil.example"}), 421, "host_not_allowed")


def test_a_foreign_page_changes_nothing(quiet_room: Room) -> None:
    refused(quiet_room.client.post(CASES, json={}, headers=EVIL), 403, "cross_site_request")


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
