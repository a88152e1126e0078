"""`/virtual-room/`: passed on to the simulation, by people who are signed in, and nothing where there is none."""

import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from services.ui_api.handlers.refusals import Refused
from services.ui_api.routes.virtual_room import VirtualRoom
from tests.unit.services.ui_api.room import Room


class _Control(BaseHTTPRequestHandler):
    """Says what it was asked."""

    def _say(self) -> None:
        sent = self.rfile.read(int(self.headers.get("Content-Length", "0"))).decode()
        content = f"{self.command} {self.path} {sent}".encode()
        self.send_response(201)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    do_GET = do_POST = do_PUT = do_DELETE = _say  # noqa: N815 - the base class's names

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - likewise
        """Say nothing."""


@pytest.fixture
def control() -> Iterator[str]:
    with HTTPServer(("127.0.0.1", 0), _Control) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


def test_method_path_and_body_are_passed_on_and_the_answer_back(control: str) -> None:
    answer = VirtualRoom(control).answer("PUT", "c-arm/turn", b'{"a": 1}')
    assert (answer.status_code, answer.body) == (201, b'PUT /c-arm/turn {"a": 1}')


def test_a_path_cannot_bring_in_another_request(control: str) -> None:
    answer = VirtualRoom(control).answer("GET", "shots HTTP/1.1\r\nHost: x\r\n\r\nDELETE /faults", b"")
    assert bytes(answer.body).startswith(b"GET /shots%20HTTP/1.1%0D%0A")


def test_a_room_that_is_gone_is_said_to_be(control: str) -> None:
    with pytest.raises(Refused, match=r"the virtual room at http://127.0.0.1:1 does not answer .*; start it"):
        VirtualRoom("http://127.0.0.1:1").answer("GET", "truth", b"")


def test_without_a_simulation_there_is_no_virtual_room(quiet_room: Room) -> None:
    for method, path in (("GET", "/virtual-room/truth"), ("POST", "/virtual-room/shots")):
        answer = quiet_room.client.request(method, path)
        assert (answer.status_code, answer.json()["code"]) == (404, "not_found")
        assert "this is no simulation" in answer.json()["detail"]
