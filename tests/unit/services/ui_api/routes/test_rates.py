"""Who asks too often is told to wait; stops, leases and health pages are not asked about."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from services.ui_api.core.roles import Role
from tests.unit.services.ui_api.people import add_account, signed_in
from tests.unit.services.ui_api.room import Room, open_room


@pytest.fixture(scope="module")
def slow_room(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Room]:
    """Two requests of a token at once, three of an address, and then hardly any."""
    with open_room(_folder(tmp_path_factory), requests_per_s=0.2, requests_per_address_per_s=0.3) as room:
        yield room


def _folder(factory: pytest.TempPathFactory) -> Path:
    return factory.mktemp("rates")


def test_too_many_requests_are_refused_with_a_time(slow_room: Room) -> None:
    answers = [slow_room.get("/users/me") for _ in range(30)]
    refused = [answer for answer in answers if answer.status_code == 429]
    assert refused, [answer.status_code for answer in answers]
    assert refused[0].json()["code"] == "rate_limited"
    assert int(refused[0].headers["retry-after"]) >= 1
    for _ in range(3):
        assert slow_room.client.post("/api/v1/robot/stop").status_code in (200, 504)
        assert slow_room.client.get("/healthz").status_code == 200
        assert slow_room.client.put("/api/v1/operations/none/lease").status_code == 404
    add_account(slow_room, "ada", Role.VIEWER)
    with signed_in(slow_room, "ada") as other:
        assert other.get("/api/v1/users/me").status_code == 200, "another token has requests of its own"
        codes = {other.get("/api/v1/users/me").json().get("code") for _ in range(30)}
    assert "rate_limited" in codes, "but the address has not as many as its tokens together"
    counted = slow_room.gateway.access.rate_limits.refused
    assert counted["token"] > 0
    assert counted["address"] > 0
