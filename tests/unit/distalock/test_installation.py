"""When an installation counts as started."""

import json
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import pytest

from distalock.installation import Installation, Ports, _Ready, why_not_ready
from services.robot.settings import RobotSettings
from services.ui_api.settings import UiApiSettings


class Gateway(ThreadingHTTPServer):
    """Answers as it is told; with no code that is not well, it is ready."""

    codes: tuple[str, ...] = ()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"


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
    assert _Ready(gateway.url)()
    assert why_not_ready(gateway.url) == ""


def test_a_service_that_is_not_there_yet_is_waited_for(gateway: Gateway) -> None:
    now_s = 0.0
    ready = _Ready(gateway.url, lambda: now_s)
    gateway.codes = ("absent", "degraded")
    assert not ready()
    now_s = 100.0
    assert not ready()


def test_what_stays_unready_is_waited_for_five_seconds(gateway: Gateway) -> None:
    now_s = 0.0
    ready = _Ready(gateway.url, lambda: now_s)
    gateway.codes = ("disconnected", "degraded")
    assert not ready()
    now_s = 5.0
    assert not ready()
    now_s = 5.1
    assert ready()
    assert why_not_ready(gateway.url) == "part: disconnected, degraded"


def test_a_gateway_that_does_not_answer_is_not_ready(gateway: Gateway) -> None:
    nobody = "http://127.0.0.1:9"
    assert not _Ready(nobody)()
    assert why_not_ready(nobody) == "the gateway does not answer"
    assert not gateway.codes


@pytest.mark.parametrize("plain_bus", [False, True])
def test_permits_are_signed_with_and_without_tls(tmp_path: Path, *, plain_bus: bool) -> None:
    Installation(Ports(1, 2, 3, 4, 5), tmp_path, "/dev/ttyUSB0", plain_bus=plain_bus).make_keys()
    signer = UiApiSettings(state_dir=tmp_path).permit_signer()
    verifier = RobotSettings(state_dir=tmp_path).permit_verifier()
    assert signer.key_sha256 == verifier.key_sha256


def test_ports_and_a_real_controller_are_reserved(tmp_path_factory: pytest.TempPathFactory) -> None:
    installation = Installation(Ports(1, 2, 3, 4, 5), tmp_path_factory.mktemp("state"), "/dev/ttyUSB0")
    assert installation._reservations() == {
        "port 1": "end it, or choose another with --router-port",
        "port 2": "end it, or choose another with --rest-port",
        "port 3": "end it, or choose another with --dicom-port",
        "the hexapod controller at /dev/ttyUSB0": "end it, or choose another with --controller",
    }
