"""Each request that the gateway refuses is in its log, with code and sender."""

import logging
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest

from tests.unit.services.ui_api.room import Room, open_room

Request = Callable[[Room], httpx.Response]
# Refused by the route, the handler behind an idempotency key, the body's model, and the router of paths.
REFUSED: tuple[Request, ...] = (
    lambda room: room.get("/cases/none"),
    lambda room: room.post("/cases/none/motions", {"plan": 1}),
    lambda room: room.post("/cases", {"nail": 1}),
    lambda room: room.get("/nothing"),
)


def test_a_refused_request_leaves_a_line(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with open_room(tmp_path) as room, caplog.at_level(logging.WARNING, "distalock.ui_api"):
        for ask in REFUSED:
            caplog.clear()
            code = ask(room).json()["code"]
            assert any(f"request refused: {code}: " in line and "127.0.0.1" in line for line in caplog.messages), code
