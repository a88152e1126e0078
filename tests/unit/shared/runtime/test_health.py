"""A container's health check: heartbeats in a file, a server that listens, an address that answers."""

import http.server
import os
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from shared.runtime.health import SILENT_AFTER_S, HealthFile, why_unwell
from shared.runtime.ready_check import why_not_ready


def test_a_service_that_beats_is_well_and_one_that_is_silent_is_not(tmp_path: Path) -> None:
    file = tmp_path / "health"
    health = HealthFile(file)
    health.note("starting")
    assert why_unwell(str(file)) == "the service is starting"
    health.note("ready")
    assert why_unwell(str(file)) == ""
    ago_s = time.time() - SILENT_AFTER_S - 1.0
    os.utime(file, (ago_s, ago_s))
    assert "the last heartbeat was 3.0 s ago (limit 2 s)" in why_unwell(str(file))
    health.note("ready")
    assert why_unwell(str(file)) == ""
    health.note("degraded")
    assert why_unwell(str(file)) == ""


def test_a_heartbeat_is_not_held_up_by_a_file_that_cannot_be_written(tmp_path: Path) -> None:
    HealthFile(tmp_path / "nowhere" / "health").note("ready")
    assert "No such file" in why_unwell(str(tmp_path / "nowhere" / "health"))


def test_a_server_is_well_while_it_listens(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        assert why_unwell(f"tcp://127.0.0.1:{port}") == ""
    assert "refused" in why_unwell(f"tcp://127.0.0.1:{port}")
    assert "No such file" in why_unwell(f"unix://{tmp_path}/socket")


class _Answering(http.server.BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        self.send_response(200 if self.path == "/readyz" else 503)
        self.end_headers()
        self.wfile.write(b'{"detail": "the robot is not there"}')

    def log_message(self, *_: object) -> None: ...


@pytest.fixture
def port() -> Iterator[int]:
    with http.server.HTTPServer(("127.0.0.1", 0), _Answering) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server.server_port
        server.shutdown()
        thread.join()


def test_an_address_is_well_when_it_answers_200_and_otherwise_says_why(port: int) -> None:
    assert why_not_ready(f"http://127.0.0.1:{port}/readyz") == ""
    assert "the robot is not there" in why_not_ready(f"http://127.0.0.1:{port}/other")


def test_an_address_without_a_server_is_not_ready() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    assert "refused" in why_not_ready(f"https://127.0.0.1:{port}/readyz")
