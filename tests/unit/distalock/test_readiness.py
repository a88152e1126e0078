"""When an installation counts as started."""

import json
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import pytest

from distalock.readiness import GatewayReady, Server, why_not_ready


class Gateway(ThreadingHTTPServer):
    """Answers as it is set; with no code that is not well, it is ready."""

    codes: tuple[str, ...] = ()

    @property
    def as_seen(self) -> Server:
        return Server(f"http://127.0.0.1:{self.server_address[1]}")


class _Answers(BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        assert isinstance(self.server, Gateway)
        codes = self.server.codes
        checks = [{"name": "part", "code": code} for code in ("ok", *codes)]
        content = json.dumps({"checks": checks, "detail": f"part: {', '.join(codes)}"}).encode()
        self.send_response(503 if codes else 200)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_: object) -> None:
        """Say nothing."""


@pytest.fixture
def gateway() -> Iterator[Gateway]:
    with Gateway(("127.0.0.1", 0), _Answers) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def test_an_installation_whose_gateway_is_ready_has_started(gateway: Gateway) -> None:
    assert GatewayReady(gateway.as_seen)()
    assert why_not_ready(gateway.as_seen) == ""


def test_a_service_that_is_not_there_yet_is_waited_for(gateway: Gateway) -> None:
    now_s = 0.0
    ready = GatewayReady(gateway.as_seen, lambda: now_s)
    gateway.codes = ("absent", "degraded")
    assert not ready()
    now_s = 100.0
    assert not ready()


def test_what_stays_unready_is_waited_for_five_seconds(gateway: Gateway) -> None:
    now_s = 0.0
    ready = GatewayReady(gateway.as_seen, lambda: now_s)
    gateway.codes = ("disconnected", "degraded")
    assert not ready()
    now_s = 5.0
    assert not ready()
    now_s = 5.1
    assert ready()
    assert why_not_ready(gateway.as_seen) == "part: disconnected, degraded"


def test_a_gateway_that_does_not_answer_is_not_ready(gateway: Gateway) -> None:
    nobody = Server("http://127.0.0.1:9")
    assert not GatewayReady(nobody)()
    assert why_not_ready(nobody) == "the gateway does not answer"
    assert not gateway.codes
